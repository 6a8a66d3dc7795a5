//! Static Gaussians (3DGS).

use crate::{
    parameterizations::{Parameterization, TimeDependence},
    setup::RawGaussian,
};
use omnilife_engine::{
    gaussians::static_gaussians::{self, StaticGaussians},
    model::Part,
    parameters::ParameterTable,
    render::reference::Gaussian,
};

/// Values of a static Gaussian: centre, scales, quaternion, opacity, constant harmonics.
pub const STATIC_VALUES: usize = 14;

/// Parameterization without time.
pub const STATIC: Parameterization = Parameterization {
    id: "static",
    in_time: TimeDependence::Still,
    table: |setup| table(&setup.gaussians),
    part: |table, _| Part::new(StaticGaussians, table),
    definition: |row, _, _| definition(row),
    unit: |_, _, _, _| 1.0,
    gradient_scale: |_, _, _| 1.0,
};

/// Writes raw values into the arrays of the static parameterization.
pub(super) fn table(gaussians: &[RawGaussian]) -> ParameterTable {
    let mut table = ParameterTable::new(gaussians.len());
    let columns: [fn(&RawGaussian) -> Vec<f64>; 5] = [
        |g| g.position.to_vec(),
        |g| g.log_scale.to_vec(),
        |g| g.quaternion.to_vec(),
        |g| vec![g.opacity_logit],
        |g| g.sh.to_vec(),
    ];
    for (shape, column) in static_gaussians::shapes(0).into_iter().zip(columns) {
        let values = gaussians
            .iter()
            .flat_map(column)
            .map(|value| value as f32)
            .collect();
        table.add(shape.name, shape.width, values, 0.0);
    }
    table
}

/// Returns `scale = exp(raw)` within bounds, `rotation = raw / max(|raw|, 1e-12)`, `opacity = sigmoid(raw)`.
pub(super) fn definition(row: &[f64]) -> Gaussian {
    let length = row[6..10].iter().map(|q| q * q).sum::<f64>().sqrt();
    let length = length.max(1e-12);
    Gaussian {
        position: [row[0], row[1], row[2]],
        scale: [row[3], row[4], row[5]].map(|raw| raw.clamp(-30.0, 20.0).exp()),
        quaternion: [row[6], row[7], row[8], row[9]].map(|raw| raw / length),
        opacity: 1.0 / (1.0 + (-row[10]).exp()),
        sh: vec![[row[11], row[12], row[13]]],
        features: Vec::new(),
    }
}
