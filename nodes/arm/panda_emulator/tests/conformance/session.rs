//! Checks 1, 2, 3, 13, 14, 17 and 18: connections, states, setters, model.

use crate::rig::{RawClient, Rig, row};
use franka::{FciVersion, Frame, FrankaError, Model};
use panda_emulator::fci::Generation;
use panda_emulator::server::{Event, Reception, ServerOptions, Session};
use panda_emulator::wire::{STATE_BYTES_MAX, encode_state};
use panda_emulator::{Panda, Settings};

#[test]
fn check_01_versions() {
    let rig = Rig::new();
    assert_eq!(rig.robot().server_version(), 5);
    let error = rig.connect(FciVersion::V10).unwrap_err();
    assert!(matches!(error, FrankaError::IncompatibleVersion { server_version: 5, library_version: 10 }), "{error:?}");
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(4), (1, 5));
    assert!(client.is_closed());

    let fr3 = Rig::with(ServerOptions {
        settings: Settings { generation: Generation::Fr3, ..Settings::default() },
        ..ServerOptions::default()
    });
    let robot = fr3.connect(FciVersion::V10).unwrap();
    assert!(robot.robot_model().unwrap().contains("link8"));
    row(1, "5 accepted, 4 and 10 refused by a Panda; 10 accepted by an FR3");
}

#[test]
fn check_01_a_second_client_is_refused() {
    let rig = Rig::new();
    let robot = rig.robot();
    assert!(RawClient::new(&rig).is_closed());
    assert!(rig.connect(FciVersion::V5).is_err());
    robot.read_once().unwrap();
    rig.wait_for("the refusal", |events| events.iter().any(|e| matches!(e, Event::ClientRefused(_))));
    row(1, "a second client is refused, the first one stays");
}

#[test]
fn check_02_states() {
    let rig = Rig::new();
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5), (0, 5));
    let states: Vec<(u64, usize)> = (0..100).map(|_| client.receive_state()).collect();
    assert!(states.iter().all(|(_, size)| *size == 2373));
    assert!(states.windows(2).all(|w| w[1].0 == w[0].0 + 1), "{states:?}");
    drop(client);
    rig.wait_for("the end", |events| events.contains(&Event::ClientLeft));
    let robot = rig.robot();
    let [a, b] = [(); 2].map(|()| robot.read_once().unwrap());
    assert!(b.time > a.time);
    row(2, "100 states of 2373 bytes, identifiers one apart");
}

#[test]
fn check_03_setters_are_echoed() {
    let rig = Rig::new();
    let robot = rig.robot();
    robot.set_collision_behavior_simple([20.0; 7], [30.0; 7], [20.0; 6], [30.0; 6]).unwrap();
    robot.set_joint_impedance([2500.0; 7]).unwrap();
    robot.set_cartesian_impedance([1500.0, 1500.0, 1500.0, 100.0, 100.0, 100.0]).unwrap();
    robot.set_guiding_mode([true; 6], true).unwrap();
    robot.set_filters(100.0, 100.0, 100.0, 100.0, 100.0).unwrap();
    let mut ee = panda_emulator::fci::IDENTITY;
    ee[14] = 0.05;
    robot.set_ee(ee).unwrap();
    robot.set_k(ee).unwrap();
    robot.set_load(0.5, [0.0, 0.0, 0.05], [1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0, 0.0, 0.0, 1e-3]).unwrap();
    robot.virtual_wall(0).unwrap();
    // States that left before the answer may still wait in the socket.
    let echoed = |state: &franka::RobotState| state.m_load > 0.0;
    let state = (0..1000).map(|_| robot.read_once().unwrap()).find(echoed).unwrap();
    assert_eq!((state.m_load, state.F_x_Cload, state.NE_T_EE, state.EE_T_K), (0.5, [0.0, 0.0, 0.05], ee, ee));
    assert!((state.F_T_EE[14] - state.F_T_NE[14] - 0.05).abs() < 1e-9, "F_T_EE = F_T_NE NE_T_EE");
    row(3, "all setters accepted and echoed");
}

#[test]
fn check_13_a_client_that_dies_makes_room() {
    let rig = Rig::new();
    for _ in 0..3 {
        let mut client = RawClient::new(&rig);
        assert_eq!(client.connect(5).0, 0);
    }
    // A client without a port for states is silent, though its connection stays.
    let mut client = RawClient::new(&rig);
    assert_eq!(client.connect(5).0, 0);
    client.datagrams = RawClient::new(&rig).datagrams;
    assert!(client.is_closed());
    rig.robot().read_once().unwrap();
    row(13, "connection closed, and port for states closed: the next client connects");
}

#[test]
fn check_14_pose_and_gravity_are_those_of_the_model() {
    let rig = Rig::new();
    let robot = rig.robot();
    let (state, model) = (robot.read_once().unwrap(), Model::native_fer());
    let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let pose = difference(&state.O_T_EE, &model.pose(Frame::EndEffector, &state));
    assert!(pose < 1e-9, "pose differs by {pose}");
    assert_eq!(state.O_ddP_O, [0.0, 0.0, -9.81]);
    // A resting Panda differed by up to 0.85 N m from its model.
    let torque = difference(&state.tau_J, &model.gravity(&state));
    assert!(torque < 0.85, "gravity torque differs by {torque} N m");
    row(14, &format!("pose within {pose:.1e} m, torque at rest within {torque:.2} N m"));
}

#[test]
fn check_17_the_model_library() {
    let rig = Rig::with(ServerOptions { model_library: Some(vec![7; 300_000]), ..ServerOptions::default() });
    let mut client = RawClient::new(&rig);
    client.connect(5);
    client.send(13, &[0, 0]);
    let (_, library) = client.receive();
    assert_eq!((library.len(), library[0], library[300_000]), (300_001, 0, 7));
    client.send(13, &[3, 0]);
    assert_eq!(client.receive(), (13, vec![1]));
    row(17, "served for x86-64 Linux; architecture 3 is answered with an error");
}

/// Bytes of all states of a scripted session: idle, a motion with torques, its end.
fn session_bytes(seed: u64) -> Vec<u8> {
    let mut session = Session::new(Panda::new(Settings::default(), seed).unwrap(), None);
    let (mut out, mut bytes) = (Vec::new(), Vec::new());
    let request = |command: u32, payload: &[u8]| {
        let size = u32::try_from(payload.len()).unwrap() + 12;
        [&[command, 0, size].map(u32::to_le_bytes).concat(), payload].concat()
    };
    let reception = session.receive(&request(0, &[5, 0, 1, 1]), &mut out);
    assert_eq!(reception, Reception::Connected { udp_port: 257 });
    let mut motion = [0; 56];
    (motion[0], motion[4]) = (2, 1);
    for cycle in 0..1000_u32 {
        if cycle == 100 {
            session.receive(&request(1, &motion), &mut out);
        }
        let state = session.cycle(&mut out).clone();
        bytes.extend_from_slice(encode_state(Generation::Panda, &state, &mut [0; STATE_BYTES_MAX]));
        let mut command = [0; 370];
        command[..8].copy_from_slice(&state.message_id.to_le_bytes());
        command[314..322].copy_from_slice(&(0.5 * (f64::from(cycle) * 0.01).sin()).to_le_bytes());
        session.receive_datagram(&command);
    }
    [out, bytes].concat()
}

#[test]
fn check_18_the_same_seed_gives_the_same_bytes() {
    let bytes = session_bytes(5);
    assert!(bytes == session_bytes(5), "the same seed gives other bytes");
    assert!(bytes != session_bytes(6), "another seed gives the same bytes");
    row(18, "1000 cycles with a motion: the same bytes with a seed, others with another");
}
