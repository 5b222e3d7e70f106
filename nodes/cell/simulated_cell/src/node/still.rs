//! Service that stills the object, as a person does by hand between two episodes.

use super::camera::Holder;
use anyhow::Result;
use catenary_msgs::std_srvs::srv::{Trigger, TriggerResponse};
use catenary_shell::Service;
use std::sync::Arc;

/// Greatest speed of a hand at rest in m/s: an arm that holds its pose trembles.
const AT_REST_M_S: f64 = 0.02;

/// Serves `~/still_object`: the object hangs at rest from the hand as it is now. The arm is not touched.
pub fn serve<H: Holder>(holder: &Arc<H>) -> Result<Service> {
    let of = Arc::clone(holder);
    Ok(holder.node().serve_to::<Trigger>("~/still_object", move |_, requester| {
        of.node().identify(requester.endpoint(), |peer| tracing::info!("still_object, asked for by {peer}"));
        of.with(|cell| {
            let [x, z] = cell.velocity_m_s();
            let speed_m_s = x.hypot(z);
            if speed_m_s > AT_REST_M_S {
                let message = format!("expected a hand at rest, got {speed_m_s:.2} m/s");
                return TriggerResponse { success: false, message };
            }
            cell.still();
            TriggerResponse { success: true, message: String::new() }
        })
    })?)
}
