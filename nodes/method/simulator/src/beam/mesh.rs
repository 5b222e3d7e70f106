//! Mesh of a beam: elements and nodal masses.

use super::parameters::BeamParameters;
use super::section::SectionProperties;
use super::terms::{ElementMaterial, ElementPlace, Terms};

/// Constants of one element.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Element {
    /// Rest length in m, and its inverse.
    pub length: f64,
    pub inverse_length: f64,
    /// Axial stiffness EA in N, shear stiffness GA in N and bending stiffness EI in N m^2.
    pub stiffness: [f64; 3],
    /// Curvature at rest in 1/m.
    pub rest_curvature: f64,
}

/// Constants of nodes and elements of one beam, from the rear end to the tip.
#[derive(Debug, Clone)]
pub(super) struct Mesh {
    pub elements: Vec<Element>,
    /// Inertia of each node in x, z and angle: kg, kg, kg m^2.
    pub inertia: Vec<[f64; 3]>,
    /// Rest length in m that belongs to each node.
    pub share: Vec<f64>,
    /// Index of the node in the grip; none for a free beam.
    pub clamped_node: Option<usize>,
    /// Index of the node at which the centre line begins: the grip, or the rear end of a free beam.
    pub origin: usize,
    /// Mean rest length of an element in m.
    pub mean_length: f64,
    /// Distance from the centre line to the surface in m.
    pub half_height: f64,
    /// Stiffnesses of each element at the start.
    first_stiffness: Vec<[f64; 3]>,
    /// Length in m that has slipped out of the grip.
    slipped: f64,
}

/// Largest share of the beam's length that may slip out of the grip.
// A bound, so that no slip speed stretches the mesh without limit.
const MOST_SLIP: f64 = 0.5;

impl Mesh {
    /// Allocates `elements` elements. [`Self::fill`] sets their values.
    pub fn new(elements: usize) -> Self {
        let blank = Element { length: 0.0, inverse_length: 0.0, stiffness: [0.0; 3], rest_curvature: 0.0 };
        Self {
            elements: vec![blank; elements],
            inertia: vec![[0.0; 3]; elements + 1],
            share: vec![0.0; elements + 1],
            clamped_node: None,
            origin: 0,
            mean_length: 0.0,
            half_height: 0.0,
            first_stiffness: vec![[0.0; 3]; elements],
            slipped: 0.0,
        }
    }

    /// Divides the beam into elements. One node lies in the grip; the overhang gets its share of the elements, at least
    /// one.
    pub fn fill(&mut self, p: &BeamParameters, terms: &Terms) {
        let count = self.elements.len();
        let behind = if p.overhang_m > 0.0 {
            ((p.overhang_m / p.length_m * count as f64).round() as usize).clamp(1, count - 1)
        } else {
            0
        };
        let length_behind = p.overhang_m / behind.max(1) as f64;
        let length_ahead = (p.length_m - p.overhang_m) / (count - behind) as f64;
        self.origin = if p.clamped { behind } else { 0 };
        self.clamped_node = p.clamped.then_some(behind);
        self.mean_length = p.length_m / count as f64;
        self.half_height = p.section.half_height_m();
        self.slipped = 0.0;
        self.share.fill(0.0);
        self.inertia.fill([0.0; 3]);
        for k in 0..count {
            let length = if k < behind { length_behind } else { length_ahead };
            // The gradient and the material terms are defined from the grip on: the overhang has the material at the
            // grip.
            let [from, middle, to] =
                [0.0, 0.5, 1.0].map(|share| (k as f64 + share - behind as f64).max(0.0) / (count - behind) as f64);
            let fraction = middle;
            let stiffer = 1.0 + p.stiffness_gradient * (2.0 * fraction - 1.0);
            let mut material = ElementMaterial {
                stiffness: [p.axial_stiffness_n, p.shear_stiffness_n, p.bending_stiffness_n_m2].map(|s| s * stiffer),
                rest_curvature_per_m: p.rest_curvature_per_m
                    + p.rest_curvature_gradient_per_m2 * (fraction - 0.5) * (p.length_m - p.overhang_m),
                mass_per_length_kg_m: p.mass_per_length_kg_m,
            };
            let place = ElementPlace { span: [from, to], length_m: length };
            for term in &terms.materials {
                term.change(&place, &mut material);
            }
            self.first_stiffness[k] = material.stiffness;
            self.elements[k] = Element {
                length,
                inverse_length: 1.0 / length,
                stiffness: material.stiffness,
                rest_curvature: material.rest_curvature_per_m,
            };
            // Lumped masses: each node carries half of its two elements.
            let mass = 0.5 * length * material.mass_per_length_kg_m;
            let rotary = 0.5 * length * p.rotary_inertia_per_length_kg_m;
            for node in [k, k + 1] {
                self.share[node] += 0.5 * length;
                self.inertia[node] =
                    [self.inertia[node][0] + mass, self.inertia[node][1] + mass, self.inertia[node][2] + rotary];
            }
        }
        self.inertia[count][0] += p.tip_mass_kg;
        self.inertia[count][1] += p.tip_mass_kg;
        self.inertia[count][2] += p.tip_load.inertia_kg_m2();
    }

    /// Sets all stiffnesses to `factor` times those at the start.
    pub fn scale_stiffness(&mut self, factor: f64) {
        for (element, first) in self.elements.iter_mut().zip(&self.first_stiffness) {
            element.stiffness = first.map(|stiffness| factor * stiffness);
        }
    }

    /// Lets `more` m of beam slip out of the grip. Every element between grip and tip grows alike, with its mass.
    pub fn slip(&mut self, more: f64, p: &BeamParameters) {
        let more = more.min(MOST_SLIP * p.length_m - self.slipped);
        self.slipped += more;
        let ahead = self.elements.len() - self.origin;
        let growth = more / ahead as f64;
        for k in self.origin..self.elements.len() {
            let element = &mut self.elements[k];
            element.length += growth;
            element.inverse_length = 1.0 / element.length;
            for node in [k, k + 1] {
                let half = 0.5 * growth;
                self.share[node] += half;
                let (mass, rotary) = (p.mass_per_length_kg_m * half, p.rotary_inertia_per_length_kg_m * half);
                let [x, z, angle] = self.inertia[node];
                self.inertia[node] = [x + mass, z + mass, angle + rotary];
            }
        }
    }

    /// Material coordinate of node `k`: fraction of the rest length from the grip (0) to the tip (1).
    pub fn fraction(&self, k: usize) -> f64 {
        k.saturating_sub(self.origin) as f64 / (self.elements.len() - self.origin) as f64
    }
}
