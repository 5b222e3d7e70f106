//! State of a beam in motion: positions, velocities and the history of the last two steps.

use super::element::{self, Direction, Strain};
use super::mesh::Mesh;
use super::node::Node;

/// State of a beam in motion.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Positions now, one step ago and two steps ago.
    pub position: Vec<Node>,
    pub position_1: Vec<Node>,
    pub position_2: Vec<Node>,
    /// Velocities now and one step ago.
    pub velocity: Vec<Node>,
    pub velocity_1: Vec<Node>,
    /// Accelerations now and one step ago.
    pub acceleration: Vec<Node>,
    pub acceleration_1: Vec<Node>,
    /// Strains of each element now and one step ago.
    pub strain: Vec<Strain>,
    pub strain_1: Vec<Strain>,
    /// Stress per stiffness of each element now in addition to the elastic one: damping and creep.
    pub extra_stress: Vec<Strain>,
    /// Relaxed elastic stress per stiffness of each element, for a creep fraction of 1.
    pub relaxed: Vec<Strain>,
    /// Direction of each element's chord now.
    pub direction: Vec<Direction>,
    /// True until the first step after the state was set: there is no history to differentiate.
    pub fresh: bool,
}

impl State {
    /// Allocates the state of `elements` elements.
    pub fn new(elements: usize) -> Self {
        let nodes = vec![[0.0; 3]; elements + 1];
        let strains = vec![[0.0; 3]; elements];
        Self {
            position: nodes.clone(),
            position_1: nodes.clone(),
            position_2: nodes.clone(),
            velocity: nodes.clone(),
            velocity_1: nodes.clone(),
            acceleration: nodes.clone(),
            acceleration_1: nodes,
            strain: strains.clone(),
            strain_1: strains.clone(),
            extra_stress: strains.clone(),
            relaxed: strains,
            direction: vec![Direction::default(); elements],
            fresh: true,
        }
    }

    /// Position of the last node.
    pub fn tip(&self) -> &Node {
        &self.position[self.position.len() - 1]
    }

    /// Shifts the history by one step. `position` keeps its value; `velocity` and `acceleration` are stale until the
    /// step ends.
    pub fn begin_step(&mut self) {
        std::mem::swap(&mut self.position_2, &mut self.position_1);
        self.position_1.copy_from_slice(&self.position);
        std::mem::swap(&mut self.velocity_1, &mut self.velocity);
        std::mem::swap(&mut self.acceleration_1, &mut self.acceleration);
        std::mem::swap(&mut self.strain_1, &mut self.strain);
    }

    /// Restarts the motion from the present positions and velocities.
    pub fn restart(&mut self, mesh: &Mesh) {
        self.position_1.copy_from_slice(&self.position);
        self.position_2.copy_from_slice(&self.position);
        self.velocity_1.copy_from_slice(&self.velocity);
        self.acceleration.fill([0.0; 3]);
        self.acceleration_1.fill([0.0; 3]);
        self.extra_stress.fill([0.0; 3]);
        self.relaxed.fill([0.0; 3]);
        for (k, element) in mesh.elements.iter().enumerate() {
            let (from, to) = (&self.position[k], &self.position[k + 1]);
            self.direction[k] = Direction::between(from, to);
            self.strain[k] = element::kinematics(element, from, to, &self.direction[k]).strain;
        }
        self.strain_1.copy_from_slice(&self.strain);
        self.fresh = true;
    }
}
