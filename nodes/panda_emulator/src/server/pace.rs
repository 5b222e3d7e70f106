//! Clock of a server.

/// Clock of the control box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// 1 kHz by the machine's clock, as a robot. A command that comes late is lost.
    #[default]
    Clock,
    /// As [`Pace::Clock`] until the first command of a motion. After it, a state leaves when the command for the last one has come:
    /// no command is lost, and motions run as fast as client and server compute. For tests on machines without real-time kernel.
    ///
    /// If a command does not come within 0.5 s, the clock runs again until the next one: half of the second after which libfranka
    /// gives up a silent robot.
    LockStep,
}
