//! The parameterizations that cases are tried on, and their definitions in f64.

use super::setup::RawGaussian;
use crate::{
    gaussians::{GaussianTable, InstantGaussians, static_gaussians},
    reference::Gaussian,
};

/// A parameterization of Gaussians with its definition.
#[derive(Debug, Clone, Copy)]
pub struct Parameterization {
    /// Id.
    pub id: &'static str,
    /// Whether it depends on time.
    pub has_time: bool,
    /// A table of raw parameters.
    pub table: fn(&[RawGaussian]) -> GaussianTable,
    /// Activates it at an instant (seconds).
    pub instantiate: fn(&GaussianTable, f64, &mut InstantGaussians),
    /// The VJP of that: from the table, what was activated, the gradients by it and the instant to
    /// the table's gradients.
    pub instantiate_vjp: fn(&mut GaussianTable, &InstantGaussians, &InstantGaussians, f64),
    /// The definition: a Gaussian of a table, all of its values array by array, at an instant.
    pub definition: fn(&[f64], f64) -> Gaussian,
}

/// All of them.
pub const PARAMETERIZATIONS: &[Parameterization] = &[STATIC];

const STATIC: Parameterization = Parameterization {
    id: "static",
    has_time: false,
    table: static_table,
    instantiate: |table, _, out| static_gaussians::instantiate(table, out),
    instantiate_vjp: |table, instant, gradient, _| {
        static_gaussians::instantiate_vjp(table, instant, gradient);
    },
    definition: |row, _| static_definition(row),
};

/// Raw values in the arrays of the static parameterization.
fn static_table(gaussians: &[RawGaussian]) -> GaussianTable {
    let mut table = GaussianTable::new(gaussians.len());
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

/// `scale = exp(raw)` within bounds, `rotation = raw / max(|raw|, 1e-12)`, `opacity = sigmoid(raw)`.
fn static_definition(row: &[f64]) -> Gaussian {
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
