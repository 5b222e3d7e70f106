//! Commands of requests.

/// Command of a request, which the versions number differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    Connect,
    Move,
    StopMove,
    GetCartesianLimit,
    SetCollisionBehavior,
    SetJointImpedance,
    SetCartesianImpedance,
    SetGuidingMode,
    SetEeToK,
    SetNeToEe,
    SetLoad,
    SetFilters,
    AutomaticErrorRecovery,
    LoadModelLibrary,
    GetRobotModel,
}

impl Command {
    /// Name as libfranka's documentation writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Connect => "Connect",
            Self::Move => "Move",
            Self::StopMove => "StopMove",
            Self::GetCartesianLimit => "GetCartesianLimit",
            Self::SetCollisionBehavior => "SetCollisionBehavior",
            Self::SetJointImpedance => "SetJointImpedance",
            Self::SetCartesianImpedance => "SetCartesianImpedance",
            Self::SetGuidingMode => "SetGuidingMode",
            Self::SetEeToK => "SetEEToK",
            Self::SetNeToEe => "SetNEToEE",
            Self::SetLoad => "SetLoad",
            Self::SetFilters => "SetFilters",
            Self::AutomaticErrorRecovery => "AutomaticErrorRecovery",
            Self::LoadModelLibrary => "LoadModelLibrary",
            Self::GetRobotModel => "GetRobotModel",
        }
    }
}
