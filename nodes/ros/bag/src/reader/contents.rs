//! Contents of a bag: topics and messages.

use crate::error::BagError;
use crate::format::profile::Profile;
use catenary_msgs::Interface;
use catenary_shell::Qos;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// Topic of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct Topic {
    /// Absolute name.
    pub name: String,
    /// `package/msg/Type`.
    pub type_name: String,
    /// Serialisation of its messages; `cdr` in all ROS 2 bags.
    pub encoding: String,
    /// RIHS01 hash of the type; none if the recorder did not know it.
    pub type_hash: Option<String>,
    /// Profiles that its publishers offered.
    pub qos: Vec<Qos>,
    /// Offered profiles with all policies, also those that [`Qos`] lacks.
    pub(crate) profiles: Vec<Profile>,
}

impl Topic {
    /// Its type, with the encoding of its messages if that is not CDR.
    #[must_use]
    pub fn describe_type(&self) -> String {
        let type_name = if self.type_name.is_empty() { "no type" } else { &self.type_name };
        match self.encoding.as_str() {
            "cdr" => type_name.to_owned(),
            "" => format!("{type_name} in no encoding"),
            other => format!("{type_name} in {other}"),
        }
    }

    /// Checks that its messages can be read as `T`.
    ///
    /// # Errors
    /// [`BagError::Type`] names the difference.
    pub fn check<T: Interface>(&self) -> Result<(), BagError> {
        let wrong = |expected: String, found: String| Err(BagError::Type { topic: self.name.clone(), expected, found });
        if self.type_name != T::TYPE_NAME {
            return wrong(T::TYPE_NAME.to_owned(), self.type_name.clone());
        }
        if self.encoding != "cdr" {
            return wrong("messages in cdr".to_owned(), format!("messages in {}", self.encoding));
        }
        match &self.type_hash {
            Some(hash) if hash != T::TYPE_HASH => {
                wrong(format!("{} with the hash {}", T::TYPE_NAME, T::TYPE_HASH), format!("the hash {hash}"))
            }
            _ => Ok(()),
        }
    }
}

/// Topic with the number of its messages.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicCount {
    /// Topic.
    pub topic: Arc<Topic>,
    /// Number of its readable messages.
    pub messages: u64,
}

/// Message of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct BagMessage {
    /// Topic of the message.
    pub topic: Arc<Topic>,
    /// Time of its reception, ns in the recorder's clock.
    pub log_time_ns: i64,
    /// Time of its sending, ns in the sender's clock.
    pub publish_time_ns: i64,
    /// CDR with its encapsulation header.
    pub data: Vec<u8>,
}

impl BagMessage {
    /// Decodes the message as a `T`.
    ///
    /// # Errors
    /// [`BagError::Type`] if the topic has another type or another version of it; [`BagError::Message`] if the bytes
    /// cannot be decoded.
    pub fn decode<T: Interface + DeserializeOwned>(&self) -> Result<T, BagError> {
        self.topic.check::<T>()?;
        catenary_msgs::from_cdr(&self.data).map_err(|e| BagError::Message {
            topic: self.topic.name.clone(),
            log_time_ns: self.log_time_ns,
            reason: e.to_string(),
        })
    }
}
