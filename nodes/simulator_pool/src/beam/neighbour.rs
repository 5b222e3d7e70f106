//! Beams that differ from another by infinitely little, in step with it: forward sensitivity analysis.
//!
//! A step makes the gradient g(q; past, parameters) of the incremental potential zero. A beam whose past, grip and
//! parameters differ by d then ends that step at q - H^-1 (g(q; d) - g(q)), to first order in d, with the Hessian H and
//! the positions q of the first one (the staggered direct method; Maly and Petzold 1996). The gradient's difference is
//! taken between the two beams as they are, so that whatever a parameter changes, a term from outside too, is in it;
//! what Newton's method left over in q cancels. No neighbour iterates or solves with a matrix of its own.

use super::body::{Beam, GripState};

impl Beam {
    /// Whether `other` may go in step with this one: the same mesh, held in the same place.
    pub fn is_neighbour_of(&self, other: &Beam) -> bool {
        self.discretisation == other.discretisation
            && self.mesh.origin == other.mesh.origin
            && self.mesh.clamped_node == other.mesh.clamped_node
            && self.steps_since_start == other.steps_since_start
    }

    /// As [`Self::advance_to`], together with `neighbours`, whose differences from this beam go on as if they were
    /// infinitely small. `grip` gives the clamped end's state of this beam (0) and of neighbour i (i + 1) at a time in s.
    /// This beam's own motion is that without neighbours, to the bit.
    pub fn advance_with(&mut self, neighbours: &mut [&mut Beam], time_s: f64, grip: impl Fn(usize, f64) -> GripState) {
        while let Some(next_s) = self.next_step_before(time_s) {
            self.step_with(neighbours, |beam| grip(beam, next_s));
        }
        self.show_at(time_s);
        neighbours.iter_mut().for_each(|n| n.show_at(time_s));
    }

    fn step_with(&mut self, neighbours: &mut [&mut Beam], grip: impl Fn(usize) -> GripState) {
        let own_grip = self.begin_step(grip(0));
        self.guess.copy_from_slice(&self.state.position);
        if !self.minimise() {
            self.counters.unconverged_steps += 1;
        }
        self.evaluate();
        self.fix_grip();
        self.system.matrix.factorise();
        for (i, neighbour) in neighbours.iter_mut().enumerate() {
            let grip = neighbour.begin_step(grip(i + 1));
            neighbour.differ(self);
            neighbour.end_step(grip);
        }
        self.end_step(own_grip);
    }

    /// Moves the positions to where they differ from those of `first`, which are final, as they should.
    fn differ(&mut self, first: &Beam) {
        let held = self.mesh.clamped_node.map(|k| (k, self.state.position[k]));
        // From where the difference goes by itself, what is left to correct is of second order in the time step.
        let places = first.state.position.as_flattened().iter().zip(first.guess.as_flattened());
        for (position, (end, guess)) in self.state.position.as_flattened_mut().iter_mut().zip(places) {
            *position = end + (*position - guess);
        }
        let (own, others) = (&self.increment.grip_spring, &first.increment.grip_spring);
        let same_unknowns = own.is_some() == others.is_some();
        if let Some((k, [x, z, angle])) = held {
            let angle = match (own, others) {
                (Some(_), Some(_)) => self.state.position[k][2],
                (Some(spring), None) => spring.angle,
                (None, _) => angle,
            };
            self.state.position[k] = [x, z, angle];
        }
        let Beam { increment, mesh, state, contact, system, .. } = self;
        if same_unknowns {
            increment.assemble::<false>(mesh, &state.position, &state.direction, contact, system);
        } else {
            self.evaluate();
        }
        let residual = first.system.gradient.as_flattened();
        for (value, residual) in self.system.gradient.as_flattened_mut().iter_mut().zip(residual) {
            *value -= residual;
        }
        self.fix_grip();
        if !same_unknowns {
            self.system.matrix.factorise();
        }
        let system = &mut self.system;
        let matrix = if same_unknowns { &first.system.matrix } else { &system.matrix };
        matrix.solve(&mut system.gradient);
        for (position, step) in self.state.position.as_flattened_mut().iter_mut().zip(system.gradient.as_flattened()) {
            *position -= step;
        }
    }
}
