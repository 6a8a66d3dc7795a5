//! Units of an ablation, one per row: a training with one component less, and its scores.
//!
//! ```text
//! OUT/split.json
//! OUT/<method>-without-<component>/run/, score/
//! ```

use std::path::Path;

use omnilife_reconstruct::methods::{Method, variant::Variant};
use omnilife_schemas::{
    layout::RUN_FILE,
    records::{SweepUnit, UnitNeeds},
};

use super::{absolute, argument, own_command, scoring, tensorboard, words};
use crate::cli::MethodArguments;

pub(crate) struct AblationRequest<'a> {
    pub(crate) scene: &'a Path,
    pub(crate) split: &'a Path,
    /// Folder of all rows.
    pub(crate) out: &'a Path,
    /// Arguments that every row has.
    pub(crate) arguments: &'a MethodArguments,
    /// Optimizer steps of every row.
    pub(crate) iterations: u64,
    /// Weights of the networks that score its views.
    pub(crate) networks: &'a [String],
    /// Share of the machine that a row takes.
    pub(crate) needs: UnitNeeds,
}

impl AblationRequest<'_> {
    /// Returns the unit of the row without one component, or with all.
    ///
    /// # Errors
    /// When a path is not UTF-8, or the options are invalid.
    pub(crate) fn unit(&self, method: &Method, without: Option<&str>) -> anyhow::Result<SweepUnit> {
        let mut row = self.arguments.clone();
        row.with.retain(|name| Some(name.as_str()) != without);
        row.without.extend(without.map(str::to_owned));
        let name = Variant::of(method, &row.request(self.iterations)?).to_string();
        let folder = absolute(&self.out.join(&name))?;
        let scene = argument(&absolute(self.scene)?)?;
        let split = argument(&absolute(self.split)?)?;
        let run = folder.join("run");
        let mut train = words(&["reconstruct", "train", &scene, "--split", &split]);
        train.extend(row.words());
        if let Some(events) = &row.tensorboard {
            train.extend(tensorboard(&events.join(&name))?);
        }
        let iterations = self.iterations.to_string();
        train.extend(words(&["--iterations", &iterations]));
        train.extend(words(&["--out", &argument(&run)?]));
        let score = scoring(&scene, &split, &run.join(RUN_FILE), &folder.join("score"))?;
        Ok(SweepUnit {
            id: name.clone(),
            group: method.id.to_owned(),
            labels: [("method".to_owned(), name)].into(),
            commands: vec![own_command(train)?, score],
            on_failure: Vec::new(),
            inputs: [&[scene, split], self.networks].concat(),
            outputs: vec![argument(&folder.join("score/result.json"))?],
            needs: self.needs,
        })
    }
}
