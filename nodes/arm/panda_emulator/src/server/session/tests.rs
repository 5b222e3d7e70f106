//! Sessions without sockets.

use super::*;
use crate::Settings;

fn session() -> Session {
    let panda = Panda::new(Settings::default(), 1).unwrap();
    Session::new(panda, Some(vec![1, 2, 3]))
}

fn request(command: u32, id: u32, payload: &[u8]) -> Vec<u8> {
    let size = u32::try_from(payload.len() + wire::HEADER_BYTES).unwrap();
    [command, id, size].iter().flat_map(|n| n.to_le_bytes()).chain(payload.iter().copied()).collect()
}

fn connect(session: &mut Session, version: u8) -> (Reception, Vec<u8>) {
    let mut out = Vec::new();
    let reception = session.receive(&request(0, 0, &[version, 0, 57, 48]), &mut out);
    (reception, out)
}

#[test]
fn a_client_of_this_version_connects() {
    let (reception, answer) = connect(&mut session(), 5);
    assert_eq!(reception, Reception::Connected { udp_port: 12345 });
    assert_eq!(answer[12..], [0, 5, 0]);
}

#[test]
fn a_client_of_another_version_is_told_this_one() {
    let mut session = session();
    for version in [4, 10] {
        let (reception, answer) = connect(&mut session, version);
        assert_eq!((reception, &answer[12..]), (Reception::Close, &[1, 5, 0][..]));
    }
    assert_eq!(session.log.take().len(), 2);
}

#[test]
fn a_request_may_come_in_pieces() {
    let mut session = session();
    connect(&mut session, 5);
    let mut out = Vec::new();
    let stops = [request(2, 1, &[]), request(2, 2, &[])].concat();
    for byte in stops {
        assert_eq!(session.receive(&[byte], &mut out), Reception::Continue);
    }
    assert_eq!((out.len(), out[4], out[17]), (26, 1, 2));
}

#[test]
fn a_request_before_connect_ends_the_session() {
    let mut out = Vec::new();
    assert_eq!(session().receive(&request(2, 0, &[]), &mut out), Reception::Close);
    assert!(out.is_empty());
}

#[test]
fn malformed_bytes_end_the_session_with_an_event() {
    for bytes in [request(99, 1, &[]), request(10, 1, &[0; 3]), [[0xFF; 12], [0; 12]].concat()] {
        let mut session = session();
        connect(&mut session, 5);
        assert_eq!(session.receive(&bytes, &mut Vec::new()), Reception::Close);
        assert!(matches!(session.log.take()[..], [(_, Event::Malformed(_))]));
    }
}

#[test]
fn a_setter_with_nan_is_refused_and_the_session_goes_on() {
    let mut session = session();
    connect(&mut session, 5);
    let mut out = Vec::new();
    let nan = f64::NAN.to_le_bytes().repeat(13);
    assert_eq!(session.receive(&request(10, 3, &nan), &mut out), Reception::Continue);
    assert_eq!(out, [10, 0, 0, 0, 3, 0, 0, 0, 13, 0, 0, 0, 2]);
}

#[test]
fn the_model_library_is_for_one_machine() {
    let mut session = session();
    connect(&mut session, 5);
    for (machine, size) in [([0, 0], 16), ([3, 0], 13), ([0, 1], 13)] {
        let mut out = Vec::new();
        session.receive(&request(13, 1, &machine), &mut out);
        assert_eq!((out.len(), out[12]), (size, u8::from(size == 13)), "{machine:?}");
    }
}

#[test]
fn the_lock_step_waits_after_the_first_command_of_a_motion() {
    let mut session = session();
    connect(&mut session, 5);
    let mut motion = [0; 56];
    motion[0] = 2;
    motion[4] = 1;
    let mut out = Vec::new();
    session.receive(&request(1, 1, &motion), &mut out);
    let mut id = session.cycle(&mut out).message_id;
    for _ in 0..3 {
        assert!(!session.waits_for_command());
        id = session.cycle(&mut out).message_id;
    }
    let mut command = [0; 370];
    command[..8].copy_from_slice(&(id - 1).to_le_bytes());
    session.receive_datagram(&command);
    assert!(session.waits_for_command(), "a command for an older state begins the lock step, and does not answer");
    command[..8].copy_from_slice(&id.to_le_bytes());
    session.receive_datagram(&command);
    assert!(session.is_stepped() && !session.waits_for_command());
    session.cycle(&mut out);
    assert!(session.waits_for_command());
    session.receive_datagram(&[]);
    assert!(!session.waits_for_command(), "an empty datagram passes");
    session.cycle(&mut out);
    session.leave();
    assert!(!session.is_stepped());
}
