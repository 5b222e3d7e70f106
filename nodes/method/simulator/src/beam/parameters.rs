//! Physical parameters of the beam and of the table.

use super::error::{BeamError, require};
use super::section::SectionProperties;
use super::tip_load::TipLoad;
use catenary_core::model::{AxialLaw, Section};

/// Physical parameters of the beam. A parameter at zero is absent: it changes no bit of the motion.
///
/// Strains of an element of rest length h whose chord d joins its nodes: stretch u = |d| / h, shear angle phi =
/// angle(d) - mean section angle, curvature kappa = difference of section angles / h. Energy per rest length: w(u) + GA
/// phi^2 / 2 + EI (kappa - rest curvature)^2 / 2, with w(u) from the axial law. Stretch is measured along the chord,
/// which keeps the law stable in tension. A projection of the chord on the section's normal is not, above 40 % strain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamParameters {
    /// Length at rest in m, from the rear end to the tip.
    pub length_m: f64,
    /// Shape of the section. Its height sets the distance from the centre line to the surface that touches the table.
    pub section: Section,
    /// Law of the axial force. Bending and shear stiffness stay those of the section at rest.
    pub axial_law: AxialLaw,
    /// Share, 0 to 1, of the law other than `axial_law`; 1 is the other law alone.
    pub other_law_share: f64,
    /// Axial stiffness EA in N.
    pub axial_stiffness_n: f64,
    /// Shear stiffness GA in N, shear coefficient included.
    pub shear_stiffness_n: f64,
    /// Bending stiffness EI in N m^2.
    pub bending_stiffness_n_m2: f64,
    /// Relative gradient g of all stiffnesses along the beam: (1 - g) of the mean at the grip, (1 + g) at the tip.
    pub stiffness_gradient: f64,
    /// Mass per rest length in kg/m.
    pub mass_per_length_kg_m: f64,
    /// Rotary inertia of the section per rest length in kg m (density times I).
    pub rotary_inertia_per_length_kg_m: f64,
    /// Kelvin-Voigt retardation time in s. Each stress gains this time times stiffness times strain rate.
    pub kelvin_voigt_time_s: f64,
    /// Bending stiffness in N m^2 that a stranded cable has in addition to EI while its strands stick to one another.
    pub sticking_stiffness_n_m2: f64,
    /// Moment in N m at which the strands slip. Small motions stay below it.
    pub slip_moment_n_m: f64,
    /// Ratio of the greatest to the least curvature at which strands slip: 1 if all slip at once.
    pub slip_spread_ratio: f64,
    /// Share of its stress that a strain loses if held for ever: standard linear solid with unrelaxed stiffness EA, GA,
    /// EI. The initial shape counts as new: nothing of it has relaxed.
    pub creep_fraction: f64,
    /// Time constant in s of that relaxation.
    pub creep_time_s: f64,
    /// Linear air drag: force per length and speed, in N s/m^2, against the velocity.
    pub linear_drag_n_s_m2: f64,
    /// Quadratic air drag: force per length and squared cross speed, in N s^2/m^3, against the velocity across the
    /// centre line (drag coefficient times air density times height / 2).
    pub quadratic_drag_n_s2_m3: f64,
    /// Mean curvature of the unloaded centre line in 1/m, positive counter-clockwise.
    pub rest_curvature_per_m: f64,
    /// Slope in 1/m^2 of that curvature along the centre line, from the grip to the tip; the mean stays.
    pub rest_curvature_gradient_per_m2: f64,
    /// Point mass at the tip in kg.
    pub tip_mass_kg: f64,
    /// Load at the tip, whose centre may lie beyond it.
    pub tip_load: TipLoad,
    /// Gravity (x, z) in m/s^2. It has an x part if the table is not level.
    pub gravity_m_s2: [f64; 2],
    /// True if a gripper holds the beam; a beam that is not held moves freely.
    pub clamped: bool,
    /// Length in m behind the grip.
    pub overhang_m: f64,
    /// Compliance of the grip: turn of the held section in rad per N m of moment. 0 holds it firmly.
    pub grip_compliance_rad_n_m: f64,
    /// Slip speed in m/s out of the grip under a pull of the beam's own weight. It is proportional to the pull.
    pub grip_slip_m_s: f64,
    /// Table; none if the beam moves in free space.
    pub table: Option<Table>,
}

/// Horizontal table that the beam's surface touches, section by section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Height z of the surface in m.
    pub height_m: f64,
    /// Coulomb coefficient of friction.
    pub friction_coefficient: f64,
    /// Normal force per length and depth in N/m^2. A larger value lets the beam sink in less and costs iterations.
    pub stiffness_n_m2: f64,
    /// Depth in m over which the stiffness rises from zero to its full value.
    pub softening_depth_m: f64,
    /// Slip speed in m/s below which friction fades; at this speed it has 71 % of its full value. A smaller value holds
    /// a resting beam better and costs iterations.
    pub slip_speed_m_s: f64,
    /// Damping time of the normal contact in s: force per unit stiffness and speed of approach.
    pub damping_time_s: f64,
    /// Adhesion in N/m: pull per length on an edge that touches the table. It fades over the first millimetre of a gap.
    pub adhesion_n_m: f64,
}

impl Table {
    /// Makes a table of the given height in m and friction coefficient.
    pub fn new(height_m: f64, friction_coefficient: f64) -> Self {
        Self {
            height_m,
            friction_coefficient,
            // A soft bar of 15 mm, which weighs 2.3 N/m, sinks in by a fifth of a millimetre.
            stiffness_n_m2: 2e4,
            softening_depth_m: 2e-4,
            // A bar that lies at rest under half its friction limit creeps at about 1 mm/s.
            slip_speed_m_s: 2e-3,
            damping_time_s: 0.0,
            adhesion_n_m: 0.0,
        }
    }

    fn check(&self) -> Result<(), BeamError> {
        require("table.height_m", "a finite number", self.height_m, |_| true)?;
        require("table.friction_coefficient", "at least zero", self.friction_coefficient, |v| v >= 0.0)?;
        require("table.stiffness_n_m2", "a positive number", self.stiffness_n_m2, |v| v > 0.0)?;
        require("table.softening_depth_m", "a positive number", self.softening_depth_m, |v| v > 0.0)?;
        require("table.slip_speed_m_s", "a positive number", self.slip_speed_m_s, |v| v > 0.0)?;
        require("table.adhesion_n_m", "at least zero", self.adhesion_n_m, |v| v >= 0.0)?;
        require("table.damping_time_s", "at least zero", self.damping_time_s, |v| v >= 0.0)
    }
}

/// Standard gravity in m/s^2.
const GRAVITY_M_S2: f64 = 9.81;

impl BeamParameters {
    /// Makes a straight, undamped, clamped beam of homogeneous isotropic material, without a table.
    ///
    /// Axial stiffness E A, bending stiffness E I, shear stiffness k E A / 2 (1 + nu) with the section's coefficient k.
    pub fn from_youngs_modulus(
        length_m: f64,
        section: Section,
        density_kg_m3: f64,
        youngs_modulus_pa: f64,
        poisson_ratio: f64,
    ) -> Self {
        let (area, second_moment) = (section.area_m2(), section.second_moment_m4());
        let axial_stiffness_n = youngs_modulus_pa * area;
        Self {
            length_m,
            section,
            axial_law: AxialLaw::Linear,
            other_law_share: 0.0,
            axial_stiffness_n,
            shear_stiffness_n: section.shear_coefficient() * axial_stiffness_n / (2.0 * (1.0 + poisson_ratio)),
            bending_stiffness_n_m2: youngs_modulus_pa * second_moment,
            mass_per_length_kg_m: density_kg_m3 * area,
            rotary_inertia_per_length_kg_m: density_kg_m3 * second_moment,
            stiffness_gradient: 0.0,
            kelvin_voigt_time_s: 0.0,
            creep_fraction: 0.0,
            creep_time_s: 2.0,
            sticking_stiffness_n_m2: 0.0,
            slip_moment_n_m: 0.0,
            slip_spread_ratio: 1.0,
            linear_drag_n_s_m2: 0.0,
            quadratic_drag_n_s2_m3: 0.0,
            rest_curvature_per_m: 0.0,
            rest_curvature_gradient_per_m2: 0.0,
            tip_mass_kg: 0.0,
            tip_load: TipLoad::default(),
            gravity_m_s2: [0.0, -GRAVITY_M_S2],
            clamped: true,
            overhang_m: 0.0,
            grip_compliance_rad_n_m: 0.0,
            grip_slip_m_s: 0.0,
            table: None,
        }
    }

    /// Makes a beam as [`Self::from_youngs_modulus`] does, from bending stiffness E I in N m^2 and axial stiffness E A
    /// in N. In a stranded cable the two are not in a solid section's proportion. Shear stiffness follows the axial
    /// stiffness.
    pub fn from_bending_stiffness(
        length_m: f64,
        section: Section,
        density_kg_m3: f64,
        bending_stiffness_n_m2: f64,
        axial_stiffness_n: f64,
        poisson_ratio: f64,
    ) -> Self {
        let youngs_modulus_pa = axial_stiffness_n / section.area_m2();
        Self {
            bending_stiffness_n_m2,
            ..Self::from_youngs_modulus(length_m, section, density_kg_m3, youngs_modulus_pa, poisson_ratio)
        }
    }

    /// Returns the mass in kg, with the tip mass and the load at the tip.
    pub fn mass_kg(&self) -> f64 {
        self.mass_per_length_kg_m * self.length_m + self.tip_mass_kg + self.tip_load.mass_kg
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`BeamError::Parameter`] naming the first field outside its range.
    pub fn check(&self) -> Result<(), BeamError> {
        let positive = [
            ("length_m", self.length_m),
            ("section", self.section.half_height_m()),
            ("axial_stiffness_n", self.axial_stiffness_n),
            ("shear_stiffness_n", self.shear_stiffness_n),
            ("bending_stiffness_n_m2", self.bending_stiffness_n_m2),
            ("mass_per_length_kg_m", self.mass_per_length_kg_m),
            ("rotary_inertia_per_length_kg_m", self.rotary_inertia_per_length_kg_m),
            ("creep_time_s", self.creep_time_s),
        ];
        for (name, value) in positive {
            require(name, "a positive number", value, |v| v > 0.0)?;
        }
        let not_negative = [
            ("kelvin_voigt_time_s", self.kelvin_voigt_time_s),
            ("sticking_stiffness_n_m2", self.sticking_stiffness_n_m2),
            ("slip_moment_n_m", self.slip_moment_n_m),
            ("linear_drag_n_s_m2", self.linear_drag_n_s_m2),
            ("quadratic_drag_n_s2_m3", self.quadratic_drag_n_s2_m3),
            ("tip_mass_kg", self.tip_mass_kg),
            ("tip_load.mass_kg", self.tip_load.mass_kg),
            ("tip_load.gyration_radius_m", self.tip_load.gyration_radius_m),
            ("grip_compliance_rad_n_m", self.grip_compliance_rad_n_m),
            ("grip_slip_m_s", self.grip_slip_m_s),
        ];
        for (name, value) in not_negative {
            require(name, "at least zero", value, |v| v >= 0.0)?;
        }
        require("slip_spread_ratio", "at least 1", self.slip_spread_ratio, |v| v >= 1.0)?;
        require("other_law_share", "0 to 1", self.other_law_share, |v| (0.0..=1.0).contains(&v))?;
        require("creep_fraction", "0 to below 1", self.creep_fraction, |v| (0.0..1.0).contains(&v))?;
        require("stiffness_gradient", "above -1 and below 1", self.stiffness_gradient, |v| v.abs() < 1.0)?;
        require("tip_load.offset_m", "a finite number", self.tip_load.offset_m, |_| true)?;
        let finite = [self.rest_curvature_per_m, self.rest_curvature_gradient_per_m2];
        for value in finite.into_iter().chain(self.gravity_m_s2) {
            require(
                "rest_curvature_per_m, rest_curvature_gradient_per_m2, gravity_m_s2",
                "finite numbers",
                value,
                |_| true,
            )?;
        }
        require("overhang_m", "at least zero and under half the length", self.overhang_m, |v| {
            v >= 0.0 && v < 0.5 * self.length_m
        })?;
        self.table.map_or(Ok(()), |table| table.check())
    }
}
