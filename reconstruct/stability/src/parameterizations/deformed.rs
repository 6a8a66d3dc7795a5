//! Static Gaussians that a network moves (Deformable-GS).
//!
//! The definition, with `u` a length, `t` the time in [0, 1] over the clip, `PE` sines and cosines of ten octaves
//! and `f` layers with rectifiers. The input enters again after the second layer:
//!
//! ```text
//! (dx, dq, ds) = f(PE(sg(mu)/u), PE(t))
//! mu + u dx        q/|q| + dq, normalized        max(exp(s) + u ds, 1e-7 u)
//! ```

use std::sync::OnceLock;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{
    parameterizations::{Parameterization, TimeDependence, still},
    setup::Setup,
};
use omnilife_engine::{
    fields::mlp::reference::{encoded, outputs},
    gaussians::deformable::{Deformable, DeformationModel, settings::DeformationSettings},
    model::Part,
    render::reference::Gaussian,
};

/// The published octaves, and layers narrow enough for plain loops.
pub const DEFORMABLE: Parameterization = Parameterization {
    id: "deformable",
    in_time: TimeDependence::Deformed,
    table: |setup| still::table(&setup.gaussians),
    part: |table, setup| {
        let settings = DeformationSettings {
            clock: setup.timing.clock,
            model: MODEL,
            warm_up_iterations: 0,
            time_noise: None,
        };
        Part::new(Deformable::new(settings, weights().to_vec()), table)
    },
    definition,
    unit: |_, _, _, _| 1.0,
    gradient_scale: |_, _, _| 1.0,
};

const MODEL: DeformationModel = DeformationModel {
    position_octaves: 10,
    time_octaves: 10,
    depth: 4,
    width: 24,
    skip_after: 1,
    length_unit: 3.0,
};

/// Returns weights with an output layer other than 0.
fn weights() -> &'static [f32] {
    static WEIGHTS: OnceLock<Vec<f32>> = OnceLock::new();
    WEIGHTS.get_or_init(|| {
        let network = MODEL.network();
        let mut values = network.initial_weights(5);
        let heads = network.layers()[MODEL.depth].hidden_weights().start;
        let mut random = Pcg64Mcg::seed_from_u64(6);
        values[heads..].fill_with(|| random.random_range(-0.05..0.05));
        values
    })
}

/// Returns the network's ten outputs for a centre.
fn network_outputs(centre: &[f64], setup: &Setup) -> Vec<f64> {
    let clock = setup.timing.clock;
    let frame = (setup.view.time_seconds - clock.origin_seconds) / clock.frame_seconds;
    let time = frame / f64::from(clock.duration_frames) + 0.5;
    let unit = f64::from(MODEL.length_unit);
    let centre: Vec<f64> = centre.iter().map(|value| value / unit).collect();
    let weights: Vec<f64> = weights().iter().map(|&weight| f64::from(weight)).collect();
    outputs(
        MODEL.network(),
        &weights,
        &encoded(&[time], MODEL.time_octaves),
        &encoded(&centre, MODEL.position_octaves),
    )
}

fn definition(row: &[f64], frozen: &[f64], setup: &Setup) -> Gaussian {
    let unit = f64::from(MODEL.length_unit);
    let output = network_outputs(&frozen[..3], setup);
    let (still, unmoved) = (still::definition(row), still::definition(frozen));
    let three = [0, 1, 2];
    Gaussian {
        position: three.map(|axis| still.position[axis] + unit * output[axis]),
        scale: three.map(|axis| {
            let added = unit * output[7 + axis];
            if unmoved.scale[axis] + added < 1e-7 * unit {
                1e-7 * unit
            } else {
                still.scale[axis] + added
            }
        }),
        quaternion: [0, 1, 2, 3].map(|axis| still.quaternion[axis] + output[3 + axis]),
        ..still
    }
}
