//! Random requests and commands: whatever a client sends, no state has a number that is not finite, and the arm moves afterwards.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a failure is a panic, a passed run prints what it met")]

use panda_emulator::fci::{Generation, IDENTITY, RobotMode, RobotState};
use panda_emulator::server::{Event, Reception, Session};
use panda_emulator::wire::{STATE_BYTES_MAX, encode_state};
use panda_emulator::{Panda, Settings};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use std::cell::Cell;

/// Cases. Each has some twenty requests, so that all have thousands.
const CASES: u32 = 120;

/// Act of a client or of the person at the robot.
#[derive(Debug, Clone)]
enum Act {
    Request {
        command: u32,
        payload: Vec<u8>,
    },
    /// Cycles, each answered by this command for the newest state; `None`: no command.
    Cycles {
        count: u32,
        command: Option<Box<[f64; 45]>>,
        finished: bool,
    },
    UserStop(bool),
    Leave,
}

fn doubles(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Numbers that a client may send by mistake or by malice.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -1.0..1.0,
        4 => 0.0..100.0,
        2 => -1e4..1e4,
        4 => prop::sample::select(vec![0.0, -0.0, 1.0, 3.0, 1e3, 1e6, 1e150, f64::MAX, f64::MIN, 5e-324, f64::NAN, f64::INFINITY]),
    ]
}

/// Payload that is valid but for a few numbers.
fn near(valid: Vec<f64>) -> impl Strategy<Value = Vec<u8>> {
    let count = valid.len();
    prop::collection::vec((0..count, number()), 0..4).prop_map(move |changes| {
        let mut numbers = valid.clone();
        changes.into_iter().for_each(|(at, number)| numbers[at] = number);
        doubles(&numbers)
    })
}

fn load() -> impl Strategy<Value = Vec<u8>> {
    let mass = prop_oneof![0.0..3.5, number()];
    let tensor = prop_oneof![Just(0.0), 0.0..0.5, number()];
    (mass, prop::array::uniform3(-0.6..0.6), tensor, number(), any::<bool>()).prop_map(
        |(mass, centre, i, off, spoilt)| {
            let off = if spoilt { off } else { 0.0 };
            doubles(&[&[mass], &centre[..], &[i, off, 0.0, off, i, 0.0, 0.0, 0.0, i]].concat())
        },
    )
}

fn frame() -> impl Strategy<Value = Vec<u8>> {
    let place = prop_oneof![3 => -1.2..1.2, 1 => number()];
    let moved = (12..15_usize, place).prop_map(|(at, place)| {
        let mut frame = IDENTITY;
        frame[at] = place;
        doubles(&frame)
    });
    prop_oneof![3 => moved, 1 => near(IDENTITY.to_vec())]
}

fn request() -> impl Strategy<Value = Act> {
    // Number 3 of a controller and 4 of a generator do not exist. The others: joint, Cartesian or no internal impedance.
    let motion = (0..4_u32, 0..5_u32, prop_oneof![3 => Just(doubles(&[10.0; 6])), 1 => near(vec![10.0; 6])]).prop_map(
        |(controller, generator, deviations)| {
            [&controller.to_le_bytes()[..], &generator.to_le_bytes(), &deviations].concat()
        },
    );
    let of = |command: u32, payload: BoxedStrategy<Vec<u8>>| {
        payload.prop_map(move |payload| Act::Request { command, payload }).boxed()
    };
    let impedance = [vec![500.0; 3], vec![30.0; 3]].concat();
    prop_oneof![
        12 => of(1, motion.boxed()),
        1 => of(2, Just(Vec::new()).boxed()),
        1 => of(3, any::<[u8; 4]>().prop_map(Vec::from).boxed()),
        3 => of(4, near(vec![40.0; 52]).boxed()),
        2 => of(5, near(vec![2000.0; 7]).boxed()),
        2 => of(6, near(impedance).boxed()),
        1 => of(7, any::<[u8; 7]>().prop_map(Vec::from).boxed()),
        3 => of(8, frame().boxed()),
        3 => of(9, frame().boxed()),
        5 => of(10, load().boxed()),
        2 => of(11, near(vec![100.0; 5]).boxed()),
        10 => of(12, Just(Vec::new()).boxed()),
        1 => of(13, any::<[u8; 2]>().prop_map(Vec::from).boxed()),
    ]
}

fn cycles() -> impl Strategy<Value = Act> {
    // Most commands are gentle, so that motions last.
    let gentle = prop::collection::vec(-5e-4..5e-4, 45);
    let wild = prop::collection::vec(number(), 45);
    let command = prop_oneof![2 => gentle.prop_map(Some), 1 => wild.prop_map(Some), 2 => Just(None)];
    (1..60_u32, command, prop::bool::weighted(0.05)).prop_map(|(count, numbers, finished)| {
        let command = numbers.map(|numbers| Box::new(<[f64; 45]>::try_from(numbers).unwrap()));
        Act::Cycles { count, command, finished }
    })
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        20 => request(),
        20 => cycles(),
        2 => prop::bool::weighted(0.2).prop_map(Act::UserStop),
        1 => Just(Act::Leave),
    ]
}

/// Session and its client.
struct Client {
    session: Session,
    out: Vec<u8>,
    requests: u64,
}

impl Client {
    fn new() -> Self {
        let settings = Settings { recovery_time_s: 0.02, ..Settings::default() };
        let session = Session::new(Panda::new(settings, 1).unwrap(), Some(vec![0; 100]));
        let mut client = Self { session, out: Vec::new(), requests: 0 };
        client.connect();
        client
    }

    fn connect(&mut self) {
        assert!(matches!(self.send(0, &[5, 0, 1, 1]), Reception::Connected { .. }));
    }

    fn send(&mut self, command: u32, payload: &[u8]) -> Reception {
        let size = u32::try_from(payload.len()).unwrap() + 12;
        let header = [command, 7, size].map(u32::to_le_bytes).concat();
        self.out.clear();
        self.session.receive(&[&header, payload].concat(), &mut self.out)
    }

    fn act(&mut self, act: &Act) {
        match act {
            Act::Request { command, payload } => {
                self.requests += 1;
                if self.send(*command, payload) == Reception::Close {
                    self.session.leave();
                    self.connect();
                }
            }
            Act::Cycles { count, command, finished } => {
                (0..*count).for_each(|_| self.cycle(command.as_deref(), *finished));
            }
            Act::UserStop(pressed) => self.session.panda.set_user_stop(*pressed),
            Act::Leave => {
                self.session.leave();
                self.connect();
            }
        }
    }

    /// Answers the newest state and runs a cycle. The command's positions are offsets from the desired ones.
    fn cycle(&mut self, numbers: Option<&[f64; 45]>, finished: bool) {
        if let Some(numbers) = numbers {
            let state = self.session.panda.state();
            let mut command = doubles(numbers);
            // 7 positions, 7 speeds, 16 numbers of a pose, 6 of a twist, 2 of an elbow; after two flags 7 torques.
            let centres = state.q_d.iter().copied().chain([0.0; 7]).chain(state.o_t_ee_c);
            for (i, centre) in centres.enumerate() {
                let offset = if i >= 14 && numbers[i].abs() < 1e-3 { 0.0 } else { numbers[i] * 1e-3 };
                command[8 * i..8 * i + 8].copy_from_slice(&(centre + offset).to_le_bytes());
            }
            let (path, torques) = command.split_at(38 * 8);
            let flags = [u8::from(numbers[44] > 0.5), u8::from(finished)];
            let id = state.message_id.to_le_bytes();
            self.session.receive_datagram(&[&id, path, &flags, torques].concat());
        }
        self.out.clear();
        self.session.cycle(&mut self.out);
        assert_finite(self.session.panda.state());
    }

    fn settle(&mut self) {
        (0..300).for_each(|_| self.cycle(None, false));
    }

    fn mode(&self) -> RobotMode {
        self.session.panda.state().robot_mode
    }

    /// Sends a request that must be answered at once with success.
    fn set(&mut self, command: u32, numbers: &[f64]) {
        self.send(command, &doubles(numbers));
        assert_eq!(self.out.get(12..), Some(&[0][..]), "command {command} in mode {:?}", self.mode());
    }

    /// Recovers, configures the arm sanely, and turns joint 7.
    fn moves(&mut self) {
        self.session.panda.set_user_stop(false);
        self.session.leave();
        self.connect();
        self.settle();
        self.send(12, &[]);
        self.settle();
        assert_eq!(self.mode(), RobotMode::Idle, "after the recovery");
        self.set(4, &[60.0; 52]);
        self.set(5, &[2000.0; 7]);
        self.set(6, &[500.0, 500.0, 500.0, 30.0, 30.0, 30.0]);
        self.set(8, &IDENTITY);
        self.set(9, &IDENTITY);
        self.set(10, &[0.0; 13]);
        self.set(11, &[1000.0; 5]);
        self.settle();
        let (motion, before) = ([&[0, 0, 0, 0, 1, 0, 0, 0][..], &doubles(&[10.0; 6])].concat(), self.joint_7());
        self.send(1, &motion);
        assert_eq!(self.out[12], 1, "the motion starts");
        for k in 0..1000 {
            let mut command = [0.0; 45];
            command[13] = 0.1 * (std::f64::consts::TAU * f64::from(k) / 1000.0).sin();
            self.speeds(&command);
            if k == 500 {
                let turned = self.joint_7() - before;
                assert!((turned - 0.0318).abs() < 5e-3, "joint 7 turned by {turned} rad");
            }
        }
        assert_eq!(self.mode(), RobotMode::Move, "{:?}", self.session.panda.state().reflex_reason);
    }

    fn joint_7(&self) -> f64 {
        self.session.panda.state().q[6]
    }

    fn speeds(&mut self, command: &[f64; 45]) {
        let mut scaled = *command;
        scaled[13] *= 1e3;
        self.cycle(Some(&scaled), false);
    }
}

fn assert_finite(state: &RobotState) {
    let mut buffer = [0; STATE_BYTES_MAX];
    let bytes = encode_state(Generation::Panda, state, &mut buffer);
    // Doubles up to the modes, and the success rate at the end.
    let numbers = bytes[8..2280].chunks_exact(8).chain([&bytes[2365..2373]]);
    for (i, number) in numbers.enumerate() {
        let number = f64::from_le_bytes(number.try_into().unwrap());
        assert!(number.is_finite(), "number {i} of the state is {number}");
    }
}

#[test]
fn thousands_of_random_requests_leave_finite_states_and_an_arm_that_moves() {
    let config = Config { cases: CASES, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Config::default() };
    let (requests, motions, reflexes) = (Cell::new(0), Cell::new(0), Cell::new(0));
    let result = TestRunner::new(config).run(&prop::collection::vec(act(), 30..90), |acts| {
        let mut client = Client::new();
        acts.iter().for_each(|act| client.act(act));
        client.moves();
        requests.set(requests.get() + client.requests);
        let events = client.session.log.take();
        let count = |holds: fn(&Event) -> bool| events.iter().filter(|(_, event)| holds(event)).count();
        motions.set(motions.get() + count(|event| *event == Event::MotionStarted));
        reflexes.set(reflexes.get() + count(|event| matches!(event, Event::Reflex(_))));
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
    println!("{} requests, {} motions, {} reflexes", requests.get(), motions.get(), reflexes.get());
    // Each case ends with one motion that holds.
    let wild = motions.get() - CASES as usize;
    assert!(requests.get() > 2000 && wild > 100 && reflexes.get() > 50, "the requests met too little");
}
