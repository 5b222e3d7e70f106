//! Tetrahedra of the bar: places, masses and damping.

use crate::beam::GripState;
use nalgebra::{Matrix3, Vector3};
use rapier3d_f64::prelude::{SoftBodyBuilder, Vector};

/// Makes a straight bar of tetrahedra along +x with the clamped end at the origin: `along` x `across` x `across` cubes
/// of five
pub(super) fn straight(length_m: f64, side_m: f64, along: usize, across: usize) -> SoftBodyBuilder {
    let middle = Vector::new(0.5 * length_m, 0.0, 0.0);
    let half = Vector::new(0.5 * length_m, 0.5 * side_m, 0.5 * side_m);
    SoftBodyBuilder::cuboid(middle, half, along + 1, across + 1, across + 1)
}

/// Returns the world's point of a point of the straight bar, held by the grip.
pub(super) fn placed(point: Vector, grip: GripState) -> Vector {
    let (sin, cos) = grip.tangent_rad.sin_cos();
    Vector::new(grip.x_m + point.x * cos - point.z * sin, point.y, grip.z_m + point.x * sin + point.z * cos)
}

/// Returns the mass in kg of every particle: a quarter of each of its tetrahedra.
pub(super) fn lumped_masses(mesh: &SoftBodyBuilder, density_kg_m3: f64) -> Vec<f64> {
    let mut masses = vec![0.0; mesh.positions.len()];
    for cell in &mesh.cells {
        let share = 0.25 * density_kg_m3 * edges(mesh, cell).determinant().abs() / 6.0;
        cell.iter().for_each(|&p| masses[p as usize] += share);
    }
    masses
}

/// Returns rapier's damping ratio for a Kelvin-Voigt material of retardation time `time_s`, as a mean over the volume.
///
/// rapier damps tetrahedron c by beta_c times its stiffness, with beta_c = 2 ratio / omega_c. omega_c is the mean over
/// the six strains of sqrt(stiffness of the strain x its inverse mass). Pinned particles have inverse mass 0.
pub(super) fn damping_ratio(
    mesh: &SoftBodyBuilder,
    youngs_modulus_pa: f64,
    poisson_ratio: f64,
    masses: &[f64],
    pinned: usize,
    time_s: f64,
) -> f64 {
    let mu = youngs_modulus_pa / (2.0 * (1.0 + poisson_ratio));
    let lambda = youngs_modulus_pa * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio));
    let (mut weighted, mut total) = (0.0, 0.0);
    for cell in &mesh.cells {
        let edges = edges(mesh, cell);
        let volume = edges.determinant().abs() / 6.0;
        let Some(inverse) = edges.try_inverse() else { continue };
        let gradients: [Vector3<f64>; 3] = [0, 1, 2].map(|k| inverse.row(k).transpose());
        let first = -(gradients[0] + gradients[1] + gradients[2]);
        let [gx, gy, gz] = [0, 1, 2].map(|axis| {
            let share = |p: usize, g: &Vector3<f64>| {
                let index = cell[p] as usize;
                if index < pinned { 0.0 } else { g[axis] * g[axis] / masses[index] }
            };
            share(0, &first) + (0..3).map(|k| share(k + 1, &gradients[k])).sum::<f64>()
        });
        let stretch = |g: f64| ((2.0 * mu + lambda) * volume * g).sqrt();
        let shear = |g: f64, h: f64| (4.0 * mu * volume * 0.25 * (g + h)).sqrt();
        let omegas = [stretch(gx), stretch(gy), stretch(gz), shear(gx, gy), shear(gx, gz), shear(gy, gz)];
        let moving = omegas.iter().filter(|w| **w > 0.0).count() as f64;
        weighted += volume * moving / omegas.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        total += volume;
    }
    0.5 * time_s * total / weighted
}

/// Returns the edges of a tetrahedron from its first particle, as columns.
fn edges(mesh: &SoftBodyBuilder, cell: &[u32; 4]) -> Matrix3<f64> {
    let point = |p: u32| {
        let v = mesh.positions[p as usize];
        Vector3::new(v.x, v.y, v.z)
    };
    let first = point(cell[0]);
    Matrix3::from_columns(&[point(cell[1]) - first, point(cell[2]) - first, point(cell[3]) - first])
}
