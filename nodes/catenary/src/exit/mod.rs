//! Ends of a command other than success: wrong input, interruption, and a result that does not fit. Each has its exit code.

mod interrupted;
mod misfit;
mod unseen;
mod wrong_input;

pub use interrupted::Interrupted;
pub use misfit::Misfit;
pub use unseen::Unseen;
pub use wrong_input::{Given, WrongInput, is_of_machine};
