mod launch;
mod nodes;
mod report;
fn main() {}
