//! One episode of a policy against the topics of the contract.
