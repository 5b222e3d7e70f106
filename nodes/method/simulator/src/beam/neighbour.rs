//! Forward sensitivity analysis: beams that differ infinitely little from another one, stepped together with it.
//!
//! A step makes the gradient g(q; past, parameters) of the incremental potential zero. A neighbour's past, grip and
//! parameters differ by d. To first order in d, the neighbour ends the step at q - H^-1 (g(q; d) - g(q)), with Hessian
//! H and positions q of the first beam (staggered direct method; Maly and Petzold 1996).
//!
//! The difference of gradients is taken between the two beams as they are. It therefore holds everything that a
//! parameter changes, terms from outside too, and the residual that Newton's method left in q cancels. No neighbour
//! iterates; it factorises a matrix of its own only if its grip has other unknowns.
use super::body::Beam;
use super::grip::GripState;

impl Beam {
    /// Returns true if `other` may be stepped together with this beam: equal mesh, held at an equal node.
    pub fn is_neighbour_of(&self, other: &Beam) -> bool {
        self.discretisation == other.discretisation
            && self.mesh.origin == other.mesh.origin
            && self.mesh.clamped_node == other.mesh.clamped_node
            && self.steps_since_start == other.steps_since_start
    }

    /// Advances as [`Self::advance_to`] does, together with `neighbours`, whose differences from this beam are propagated
    /// to first order. `grip(i, t)` gives the state of the clamped end at time t in s: i = 0 is this beam, i + 1 is
    /// neighbour i. This beam moves bit for bit as it would alone.
    pub fn advance_with(&mut self, neighbours: &mut [&mut Beam], time_s: f64, grip: impl Fn(usize, f64) -> GripState) {
        while let Some(next_s) = self.next_step_before(time_s) {
            self.step_with(neighbours, |beam| grip(beam, next_s));
        }
        self.interpolate_at(time_s);
        neighbours.iter_mut().for_each(|n| n.interpolate_at(time_s));
    }

    fn step_with(&mut self, neighbours: &mut [&mut Beam], grip: impl Fn(usize) -> GripState) {
        let own_grip = self.begin_step(grip(0));
        self.guess.copy_from_slice(&self.state.position);
        if !self.minimise() {
            self.counters.unconverged_steps += 1;
        }
        // The Hessian must belong to the final positions, not to those before the last Newton step.
        self.evaluate();
        self.fix_grip();
        self.system.matrix.factorise();
        for (i, neighbour) in neighbours.iter_mut().enumerate() {
            let grip = neighbour.begin_step(grip(i + 1));
            neighbour.propagate_difference(self);
            neighbour.end_step(grip);
        }
        self.end_step(own_grip);
    }

    /// Sets the positions by the linearised step: the final positions of `first` plus the propagated difference.
    fn propagate_difference(&mut self, first: &Beam) {
        let held = self.mesh.clamped_node.map(|k| (k, self.state.position[k]));
        // Starting from the difference of the predictions leaves a correction of second order in the time step.
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
        // With equal unknowns the first beam's factorised matrix serves, and the neighbour's own Hessian is not needed.
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
