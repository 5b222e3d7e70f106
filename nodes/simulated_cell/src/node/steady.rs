//! Service that stills the object, as a person does by hand between two episodes.

use super::camera::Holder;
use anyhow::Result;
use catenary_msgs::std_srvs::srv::{Trigger, TriggerResponse};
use catenary_shell::Service;
use std::sync::Arc;

/// Serves `~/steady_object`: the object hangs at rest from the hand as it is now. The arm is not touched.
pub fn serve<H: Holder>(holder: &Arc<H>) -> Result<Service> {
    let of = Arc::clone(holder);
    Ok(holder.node().serve_to::<Trigger>("~/steady_object", move |_, requester| {
        tracing::info!("steady_object, asked for by {requester}");
        of.with(crate::cell::Cell::steady);
        TriggerResponse { success: true, message: String::new() }
    })?)
}
