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
    /// If a command does not come within the patience, the clock runs again until the next one.
    LockStep,
    /// As [`Pace::Clock`], but a state waits for the command that answers the one before it: at most 1 kHz, and no command is late. The
    /// clock in the states advances by 1 ms a state, thus slower than the machine's while the client is slow. For clients that look at a
    /// clock themselves, on machines that are busy.
    ///
    /// If a command does not come within the patience, 1 kHz holds again until the next one, so that a client that has gone is noticed.
    Elastic,
}
