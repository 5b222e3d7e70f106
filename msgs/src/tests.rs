//! Invariants of the generated types, and hashes that rosidl computed.

use crate::action_msgs::srv::CancelGoal;
use crate::catenary_msgs::action::Infer;
use crate::catenary_msgs::msg::{ArmState, Keypoints};
use crate::catenary_msgs::srv::{CloseEnvs, Simulate, SimulateRequest, StepEnvsResponse};
use crate::diagnostic_msgs::msg::{DiagnosticArray, DiagnosticStatus, KeyValue};
use crate::geometry_msgs::msg::{Quaternion, TransformStamped, Vector3};
use crate::sensor_msgs::msg::{CameraInfo, Image, JointState};
use crate::std_srvs::srv::{SetBool, SetBoolRequest, SetBoolResponse, TriggerRequest};
use crate::type_description_interfaces::srv::GetTypeDescription;
use crate::{
    ActionInterface, Interface, ServiceInterface, described, find, from_cdr, messages, services_and_actions,
    structures, to_cdr,
};
use proptest::collection::vec;
use proptest::prelude::*;
use serde::{Serialize, de::DeserializeOwned};

#[test]
fn an_answer_with_fields_for_it_reports_a_failure_and_its_reason() {
    let reason = || "too large".to_owned();
    let simulated = Simulate::refusal(reason()).unwrap();
    assert_eq!((simulated.success, simulated.message, simulated.tracks.len()), (false, reason(), 0));
    assert_eq!(CloseEnvs::refusal(reason()).unwrap().message, reason());
    let inferred = Infer::refusal(reason()).unwrap();
    assert_eq!((inferred.success, inferred.message), (false, reason()));
    let described = GetTypeDescription::refusal(reason()).unwrap();
    assert_eq!((described.successful, described.failure_reason), (false, reason()));
    assert!(CancelGoal::refusal(reason()).is_none());
}

#[test]
fn hashes_equal_those_of_the_jazzy_packages() {
    let messages = [
        ("std_msgs/msg/Header", "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"),
        ("geometry_msgs/msg/PoseStamped", "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"),
        ("sensor_msgs/msg/Image", "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"),
        ("sensor_msgs/msg/CameraInfo", "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"),
        ("rcl_interfaces/msg/Log", "e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac"),
        ("diagnostic_msgs/msg/DiagnosticArray", "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"),
    ];
    for (name, hash) in messages {
        assert_eq!(find(name).unwrap().type_hash, format!("RIHS01_{hash}"), "{name}");
    }
    let services = [
        ("std_srvs/srv/Trigger", "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"),
        (
            "type_description_interfaces/srv/GetTypeDescription",
            "69b9c19c1021405984cc60dbbb1edceb147a6538b411d812ba6afabeed962cd5",
        ),
        ("action_msgs/srv/CancelGoal", "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a"),
    ];
    for (name, hash) in services {
        let (_, ours) = services_and_actions().iter().find(|(n, _)| *n == name).unwrap();
        assert_eq!(*ours, format!("RIHS01_{hash}"), "{name}");
    }
    let empty_request = "d010825374ce8918e72bfd826c82603e60f45419e932ea976f807b74a863a199";
    assert_eq!(TriggerRequest::TYPE_HASH, format!("RIHS01_{empty_request}"));
}

#[test]
fn a_description_contains_the_type_and_every_type_it_refers_to() {
    let (description, sources) = described("geometry_msgs/msg/PoseStamped").unwrap();
    let own = &description.type_description;
    assert_eq!(own.fields.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["header", "pose"]);
    assert_eq!(own.fields[1].r#type.nested_type_name, "geometry_msgs/msg/Pose");
    let referenced: Vec<&str> = description.referenced_type_descriptions.iter().map(|d| d.type_name.as_str()).collect();
    let expected = [
        "builtin_interfaces/msg/Time",
        "geometry_msgs/msg/Point",
        "geometry_msgs/msg/Pose",
        "geometry_msgs/msg/Quaternion",
        "std_msgs/msg/Header",
    ];
    assert_eq!(referenced, expected);
    let w = &description.referenced_type_descriptions[3].fields[3];
    assert_eq!((w.name.as_str(), w.default_value.as_str()), ("w", "1.0"));
    assert_eq!(sources.len(), 6);
    assert!(sources.iter().all(|s| s.encoding == "msg" && s.raw_file_contents.ends_with(char::is_alphanumeric)));
    let (_, sources) = described("std_srvs/srv/SetBool_Request").unwrap();
    assert_eq!((sources[0].encoding.as_str(), sources[0].raw_file_contents.as_str()), ("implicit", ""));
    assert_eq!(described("std_msgs/msg/NoSuchThing"), None);
    assert!(structures().windows(2).all(|pair| pair[0].type_name < pair[1].type_name));
}

#[test]
fn names_follow_rosidl() {
    assert_eq!(Keypoints::TYPE_NAME, "catenary_msgs/msg/Keypoints");
    assert_eq!(SetBoolRequest::TYPE_NAME, "std_srvs/srv/SetBool_Request");
    assert_eq!(<SetBool as ServiceInterface>::TYPE_NAME, "std_srvs/srv/SetBool");
    assert_eq!(<Infer as ActionInterface>::TYPE_NAME, "catenary_msgs/action/Infer");
    assert_eq!(<<Infer as ActionInterface>::Goal as Interface>::TYPE_NAME, "catenary_msgs/action/Infer_Goal");
    assert_eq!(find("sensor_msgs/msg/NoSuchThing"), None);
}

#[test]
fn every_definition_contains_each_nested_definition_once() {
    let rule = format!("\n{}\nMSG: ", "=".repeat(80));
    for info in messages() {
        let mut nested: Vec<&str> = info.definition.split(&rule).skip(1).map(|d| d.lines().next().unwrap()).collect();
        let count = nested.len();
        nested.sort_unstable();
        nested.dedup();
        assert_eq!(nested.len(), count, "{}", info.type_name);
        for name in nested {
            assert!(find(&name.replace('/', "/msg/")).is_some(), "{}: {name}", info.type_name);
        }
    }
    let names: Vec<&str> =
        TransformStamped::DEFINITION.split(&rule).skip(1).map(|d| d.lines().next().unwrap()).collect();
    let wanted = ["std_msgs/Header", "geometry_msgs/Transform", "builtin_interfaces/Time", "geometry_msgs/Vector3"];
    assert_eq!(names, [&wanted[..], &["geometry_msgs/Quaternion"]].concat());
}

#[test]
fn constants_carry_over() {
    assert_eq!((ArmState::MODE_IDLE, ArmState::MODE_DISCONNECTED), (0, 6));
    assert_eq!((DiagnosticStatus::OK, DiagnosticStatus::STALE), (0, 3));
    assert_eq!(crate::action_msgs::srv::CancelGoalResponse::ERROR_GOAL_TERMINATED, 3);
    assert_eq!(SimulateRequest::FIDELITY_REFERENCE, 2);
}

#[test]
fn an_empty_request_carries_one_byte() {
    assert_eq!(to_cdr(&TriggerRequest::default()).unwrap(), [0, 1, 0, 0, 0]);
}

#[test]
fn big_endian_messages_are_read() {
    let bytes = [0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 3, b'o', b'k', 0];
    let expected = SetBoolResponse { success: true, message: "ok".into() };
    assert_eq!(from_cdr::<SetBoolResponse>(&bytes).unwrap(), expected);
}

#[test]
fn a_length_beyond_the_bytes_is_an_error_not_an_allocation() {
    let mut bytes = to_cdr(&Image::default()).unwrap();
    let length = bytes.len() - 4;
    bytes[length..].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(from_cdr::<Image>(&bytes).is_err());
    let mut bytes = to_cdr(&StepEnvsResponse::default()).unwrap();
    let length = bytes.len() - 4;
    bytes[length..].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(from_cdr::<StepEnvsResponse>(&bytes).is_err());
}

fn text() -> impl Strategy<Value = String> {
    // CDR terminates strings with a zero byte, so a string cannot contain one.
    "[^\0]{0,9}"
}

fn number() -> impl Strategy<Value = f64> {
    proptest::num::f64::NORMAL | proptest::num::f64::SUBNORMAL | proptest::num::f64::ZERO | proptest::num::f64::INFINITE
}

fn stays<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(message: &T) -> Result<(), TestCaseError> {
    let bytes = to_cdr(message).unwrap();
    prop_assert_eq!(&from_cdr::<T>(&bytes).unwrap(), message);
    // The encoding is complete: no proper prefix is a message of the type.
    prop_assert!(from_cdr::<T>(&bytes[..bytes.len() - 1]).is_err());
    Ok(())
}

proptest! {
    #[test]
    fn images_round_trip(encoding in text(), frame_id in text(), height: u32, is_bigendian: u8, data: Vec<u8>) {
        let mut image = Image { encoding, height, is_bigendian, data, ..Image::default() };
        image.header.frame_id = frame_id;
        stays(&image)?;
    }

    #[test]
    fn transforms_round_trip(child_frame_id in text(), sec: i32, nanosec: u32, v in proptest::array::uniform7(number())) {
        let mut t = TransformStamped { child_frame_id, ..TransformStamped::default() };
        (t.header.stamp.sec, t.header.stamp.nanosec) = (sec, nanosec);
        t.transform.translation = Vector3 { x: v[0], y: v[1], z: v[2] };
        t.transform.rotation = Quaternion { x: v[3], y: v[4], z: v[5], w: v[6] };
        stays(&t)?;
    }

    #[test]
    fn joint_states_round_trip(name in vec(text(), 0..8), position in vec(number(), 0..8), effort in vec(number(), 0..8)) {
        stays(&JointState { name, position, effort, ..JointState::default() })?;
    }

    #[test]
    fn arrays_and_bools_round_trip(k in proptest::array::uniform9(number()), d in vec(number(), 0..6), do_rectify: bool) {
        let mut info = CameraInfo { k, d, ..CameraInfo::default() };
        info.roi.do_rectify = do_rectify;
        stays(&info)?;
    }

    #[test]
    fn nested_sequences_round_trip(rows in vec((text(), text(), vec((text(), text()), 0..3)), 0..4)) {
        let pair = |(key, value)| KeyValue { key, value };
        let status = |(name, message, values): (String, String, Vec<(String, String)>)| DiagnosticStatus {
            level: DiagnosticStatus::WARN,
            name,
            message,
            values: values.into_iter().map(pair).collect(),
            ..DiagnosticStatus::default()
        };
        stays(&DiagnosticArray { status: rows.into_iter().map(status).collect(), ..DiagnosticArray::default() })?;
    }

    #[test]
    fn requests_round_trip(model_yaml in text(), theta in vec(number(), 0..5), policy: Vec<u8>, seed: u64, noise: bool) {
        stays(&SimulateRequest { model_yaml, theta, policy, seed, noise, ..SimulateRequest::default() })?;
    }

    #[test]
    fn no_bytes_make_the_reader_panic(mut bytes in vec(any::<u8>(), 4..200)) {
        // A valid header, so that the arbitrary bytes reach the decoder.
        bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
        let _ = from_cdr::<Image>(&bytes);
        let _ = from_cdr::<DiagnosticArray>(&bytes);
        let _ = from_cdr::<JointState>(&bytes);
        let _ = from_cdr::<SimulateRequest>(&bytes);
    }
}
