//! Layouts against those of franka-rs, which were written independently, and messages there and back.

use super::*;
use crate::fci::{
    Answer, ControllerMode, ErrorKind, Errors, Generator, MoveStatus, RecoveryStatus, Request, RobotMode, SetterStatus,
    StopStatus,
};
use franka::wire::robot::{v5 as theirs5, v10 as theirs10};
use std::mem::offset_of;

fn encoded(generation: Generation, state: &RobotState) -> Vec<u8> {
    encode_state(generation, state, &mut [0; STATE_BYTES_MAX]).to_vec()
}

/// Name of a field, its offset by franka-rs, and a function that fills ours with ones.
type Field = (&'static str, usize, fn(&mut RobotState));

/// Fields of a list of names.
macro_rules! offsets {
    ($theirs:ident: $($ours:ident $name:ident),* $(,)?) => {
        [$((
            stringify!($name),
            offset_of!($theirs::RobotState, $name),
            (|s: &mut RobotState| s.$ours = s.$ours.map(|_| 1.0)) as fn(&mut RobotState),
        )),*]
    };
}

macro_rules! all_offsets {
    ($theirs:ident) => {
        offsets!($theirs: o_t_ee O_T_EE, o_t_ee_d O_T_EE_d, f_t_ee F_T_EE, ee_t_k EE_T_K, f_t_ne F_T_NE, ne_t_ee NE_T_EE,
            i_ee I_ee, f_x_cee F_x_Cee, i_load I_load, f_x_cload F_x_Cload, elbow elbow, elbow_d elbow_d, tau_j tau_J,
            tau_j_d tau_J_d, dtau_j dtau_J, q q, q_d q_d, dq dq, dq_d dq_d, ddq_d ddq_d, joint_contact joint_contact,
            cartesian_contact cartesian_contact, joint_collision joint_collision,
            cartesian_collision cartesian_collision, tau_ext_hat_filtered tau_ext_hat_filtered,
            o_f_ext_hat_k O_F_ext_hat_K, k_f_ext_hat_k K_F_ext_hat_K, o_dp_ee_d O_dP_EE_d, o_ddp_o O_ddP_O,
            elbow_c elbow_c, delbow_c delbow_c, ddelbow_c ddelbow_c, o_t_ee_c O_T_EE_c, o_dp_ee_c O_dP_EE_c,
            o_ddp_ee_c O_ddP_EE_c, theta theta, dtheta dtheta)
    };
}

fn zeroed() -> RobotState {
    let z = [0.0; 16];
    RobotState {
        o_t_ee: z,
        o_t_ee_d: z,
        f_t_ee: z,
        ee_t_k: z,
        f_t_ne: z,
        ne_t_ee: z,
        o_t_ee_c: z,
        ..RobotState::default()
    }
}

fn assert_fields(generation: Generation, offsets: &[Field]) {
    let empty = encoded(generation, &zeroed());
    for (name, offset, fill) in offsets {
        let mut state = zeroed();
        fill(&mut state);
        let got = encoded(generation, &state);
        let first = got.iter().zip(&empty).position(|(a, b)| a != b).unwrap();
        // The two low bytes of 1.0 are zero: the number begins up to 6 (f64) or 2 (f32) bytes earlier.
        let lead = if generation == Generation::Panda { 6 } else { 2 };
        assert_eq!(first - lead, *offset, "{name} of {generation:?}");
    }
}

#[test]
fn states_have_the_offsets_of_an_independent_layout() {
    assert_eq!(state_bytes(Generation::Panda), size_of::<theirs5::RobotState>());
    assert_eq!(state_bytes(Generation::Fr3), size_of::<theirs10::RobotState>());
    assert_fields(Generation::Panda, &all_offsets!(theirs5));
    assert_fields(Generation::Fr3, &all_offsets!(theirs10));
}

#[test]
fn states_fill_their_layout_exactly() {
    let mut datagram = [0; STATE_BYTES_MAX];
    assert_eq!(v5::encode_state(&RobotState::default(), &mut datagram), 2373);
    assert_eq!(v10::encode_state(&RobotState::default(), &mut datagram), 1377);
}

#[test]
fn modes_and_errors_stand_behind_the_numbers() {
    let state = RobotState {
        motion: Some((Generator::JointVelocity, ControllerMode::External)),
        errors: Errors::of(ErrorKind::JointPositionLimitsViolation),
        reflex_reason: Errors::of(ErrorKind::CommunicationConstraintsViolation),
        robot_mode: RobotMode::Reflex,
        control_command_success_rate: 0.5,
        message_id: 0x0102_0304_0506_0708,
        m_ee: 0.73,
        m_load: 0.5,
        ..zeroed()
    };
    let v5 = encoded(Generation::Panda, &state);
    assert_eq!(v5[..8], 0x0102_0304_0506_0708_u64.to_le_bytes());
    assert_eq!(v5[776..784], 0.73_f64.to_le_bytes());
    assert_eq!(v5[880..888], 0.5_f64.to_le_bytes());
    assert_eq!((v5[2280], v5[2281], v5[2282], v5[2323 + 25], v5[2364]), (2, 2, 1, 1, 4));
    assert_eq!(v5[2282..2364].iter().map(|b| u32::from(*b)).sum::<u32>(), 2);
    assert_eq!(v5[2365..], 0.5_f64.to_le_bytes());

    let v10 = encoded(Generation::Fr3, &state);
    assert_eq!(v10[offset_of!(theirs10::RobotState, m_load)..][..4], 0.5_f32.to_le_bytes());
    assert_eq!(v10[offset_of!(theirs10::RobotState, errors)], 1);
    assert_eq!(v10[offset_of!(theirs10::RobotState, reflex_reason) + 25], 1);
    assert_eq!(v10[offset_of!(theirs10::RobotState, robot_mode)], 4);
    assert_eq!(v10[1373..], 0.5_f32.to_le_bytes());

    let idle = encoded(Generation::Panda, &zeroed());
    assert_eq!((idle[2280], idle[2281], idle[2364]), (0, 3, 0), "a state without a motion has modes idle and other");
}

#[test]
fn commands_are_read_where_an_independent_layout_has_them() {
    assert_eq!(
        (v5::COMMAND_BYTES, v10::COMMAND_BYTES),
        (size_of::<theirs5::RobotCommand>(), size_of::<theirs10::RobotCommand>())
    );
    let motion = offset_of!(theirs5::RobotCommand, motion);
    let at = |name| motion + name;
    let mut datagram = [0; v5::COMMAND_BYTES];
    let mut put = |offset: usize, number: f64| datagram[offset..offset + 8].copy_from_slice(&number.to_le_bytes());
    put(at(offset_of!(theirs5::MotionGeneratorCommand, q_c)), 1.0);
    put(at(offset_of!(theirs5::MotionGeneratorCommand, dq_c)), 2.0);
    put(at(offset_of!(theirs5::MotionGeneratorCommand, O_T_EE_c)), 3.0);
    put(at(offset_of!(theirs5::MotionGeneratorCommand, O_dP_EE_c)), 4.0);
    put(at(offset_of!(theirs5::MotionGeneratorCommand, elbow_c)), 5.0);
    put(offset_of!(theirs5::RobotCommand, control), f64::NAN);
    datagram[0] = 7;
    datagram[312] = 1;
    let command = decode_command(Generation::Panda, &datagram).unwrap();
    assert_eq!((command.message_id, command.q_c[0], command.dq_c[0]), (7, 1.0, 2.0));
    assert_eq!((command.o_t_ee_c[0], command.o_dp_ee_c[0], command.elbow_c), (3.0, 4.0, Some([5.0, 0.0])));
    assert!(command.tau_j_d[0].is_nan() && !command.finished);
    datagram[313] = 1;
    datagram[312] = 0;
    let command = decode_command(Generation::Panda, &datagram).unwrap();
    assert_eq!((command.elbow_c, command.finished), (None, true));

    let mut datagram = [0; v10::COMMAND_BYTES];
    datagram[370] = 1;
    assert!(decode_command(Generation::Fr3, &datagram).unwrap().finished);
}

#[test]
fn a_command_of_another_length_is_an_error() {
    for (generation, length) in [(Generation::Panda, 371), (Generation::Fr3, 370), (Generation::Panda, 0)] {
        let error = decode_command(generation, &vec![0; length]).unwrap_err();
        assert!(matches!(error, WireError::Length { got, .. } if got == length), "{error}");
    }
}

#[test]
fn every_command_has_the_payload_that_clients_send() {
    // Sizes with header that libfranka 0.9.2 sent.
    let sizes = [16, 68, 12, 16, 428, 68, 60, 19, 140, 140, 116, 52, 12, 14];
    for (command, size) in (0..).zip(sizes) {
        assert!(decode_message(Generation::Panda, command, &vec![0; size - HEADER_BYTES]).is_ok(), "command {command}");
        let error = decode_message(Generation::Panda, command, &vec![0; size]).unwrap_err();
        assert!(matches!(error, WireError::Length { .. }), "{error}");
    }
    assert!(matches!(
        decode_message(Generation::Panda, 14, &[]),
        Err(WireError::UnknownCommand { version: 5, command: 14 })
    ));
    assert_eq!(decode_message(Generation::Fr3, 11, &[]), Ok(ClientMessage::Request(Box::new(Request::GetRobotModel))));
}

#[test]
fn values_that_are_no_numbers_are_errors() {
    let mut load = vec![0; 104];
    load[..8].copy_from_slice(&f64::NAN.to_le_bytes());
    let error = decode_message(Generation::Panda, 10, &load).unwrap_err();
    assert_eq!(error.to_string(), "SetLoad: expected finite numbers");
    let mut motion = vec![0; 56];
    motion[4] = 4;
    assert!(decode_message(Generation::Panda, 1, &motion).is_err(), "FCI 5 has no motion without a generator");
    motion.resize(113, 0);
    assert!(decode_message(Generation::Fr3, 1, &motion).is_ok());
}

#[test]
fn answers_have_the_sizes_and_numbers_of_their_version() {
    let encode = |generation, answer: &Answer| {
        let mut out = Vec::new();
        encode_answer(generation, 9, answer, &mut out);
        out
    };
    let reflex = Answer::Move(MoveStatus::ReflexAborted);
    assert_eq!(encode(Generation::Panda, &reflex), [1, 0, 0, 0, 9, 0, 0, 0, 13, 0, 0, 0, 6]);
    assert_eq!(encode(Generation::Fr3, &reflex)[12], 8);
    assert_eq!(encode(Generation::Fr3, &Answer::Stop(StopStatus::EmergencyAborted))[12], 3);
    let manual = Answer::Recovery(RecoveryStatus::ManualErrorRecoveryRequiredRejected);
    assert_eq!((encode(Generation::Panda, &manual)[12], encode(Generation::Fr3, &manual)[12]), (2, 3));
    let limit = Answer::CartesianLimit(SetterStatus::Success, [1.0; 3], crate::fci::IDENTITY, true);
    assert_eq!(encode(Generation::Panda, &limit).len(), 166);
    let filters = Answer::Setter(Request::SetFilters([100.0; 5]), SetterStatus::InvalidArgumentRejected);
    assert_eq!(encode(Generation::Panda, &filters)[..1], [11]);
    assert_eq!(encode(Generation::Panda, &Answer::ModelLibrary(Some(vec![1, 2])))[8..], [15, 0, 0, 0, 0, 1, 2]);
    let mut connect = Vec::new();
    encode_connect(Generation::Panda, 0, false, &mut connect);
    assert_eq!(connect, [0, 0, 0, 0, 0, 0, 0, 0, 15, 0, 0, 0, 1, 5, 0]);
}
