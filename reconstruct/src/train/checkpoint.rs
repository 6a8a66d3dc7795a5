//! Checkpoints: everything that training needs to go on as if it had never stopped.
//!
//! ```text
//! omnilife/checkpoint/2\n
//! {"inputs_sha256": ..., "settings": ..., "state": ..., "tables": ..., "body_sha256": ...}\n
//! body: f32, little-endian; for each array of the static Gaussians its values, first and second
//!       moments; then the sums of their density statistics, and their views as u32; then the same
//!       of moving Gaussians, where there are any, and the sums of their time gradients; then the
//!       weights of a network with their moments, where there is one; then the corrections of poses
//!       with theirs, array by array, where poses are refined
//! ```
//!
//! Gradients are not kept: every step overwrites them. On the processor a run that is continued
//! gives the same bits as one that was never interrupted, unless a time budget steers it.

use std::{fs, io::Write, path::Path, time::Duration};

use omnilife_schemas::store::{self, StoreError};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::train::trace::TracePoint;
use omnilife_engine::{
    gaussians::deformable::DeformationWeights,
    model::Statistics,
    parameters::{ParameterArray, ParameterTable},
};
use omnilife_engine::{
    model::{Model, MovingGaussians},
    step::{StepSums, settings::TrainSettings},
};

const MAGIC: &str = "omnilife/checkpoint/";
const VERSION: &str = "2";

/// Where the loop stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopState {
    /// Iterations done.
    pub iteration: u64,
    /// Of view order and split noise.
    pub random: Pcg64Mcg,
    /// Views left in this epoch, the next one last.
    pub queue: Vec<usize>,
    /// The iteration of the schedule at which opacities were reset last.
    pub last_reset: u64,
    /// Wall-clock time of the training steps.
    pub training: Duration,
    /// Wall-clock time of the trace's renders.
    pub evaluation: Duration,
    /// Processor time of the training steps, where the system tells.
    pub training_cpu: Option<Duration>,
    /// Sums over the steps since the last row of the trace.
    pub since_trace: StepSums,
    /// Gradient values that were not finite, for each array, over the whole run.
    pub refused: Vec<u64>,
    /// Error against run time.
    pub trace: Vec<TracePoint>,
    /// How often the run was interrupted and continued.
    pub resumed: u64,
}

/// A checkpoint in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Where the loop stands.
    pub state: LoopState,
    /// The Gaussians with their moments, and the density statistics.
    pub model: Model,
}

#[derive(Serialize, Deserialize)]
struct Header {
    inputs_sha256: String,
    settings: TrainSettings,
    state: LoopState,
    /// The static Gaussians, and the moving ones where there are any.
    tables: Vec<TableHeader>,
    #[serde(default)]
    deformation: Option<DeformationHeader>,
    /// Steps of each input view's pose.
    #[serde(default)]
    pose_steps: Option<Vec<u64>>,
    body_sha256: String,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
struct DeformationHeader {
    weights: usize,
    steps: u64,
}

#[derive(Serialize, Deserialize)]
struct TableHeader {
    gaussians: usize,
    arrays: Vec<ArrayHeader>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct ArrayHeader {
    name: String,
    width: usize,
}

/// Why a checkpoint cannot be continued.
#[derive(Debug)]
pub enum Refusal {
    /// It belongs to another scene, split, method or configuration: training begins anew.
    OtherRun(String),
    /// It cannot be used by anything.
    Damaged(StoreError),
}

/// Writes a checkpoint, whole or not at all.
///
/// # Errors
/// When the file cannot be written, or a parameter is not finite: a poisoned model is no checkpoint.
pub fn write(
    path: &Path,
    inputs_sha256: &str,
    settings: &TrainSettings,
    state: &LoopState,
    model: &Model,
) -> Result<(), StoreError> {
    let failed = |reason: String| StoreError::write(path, std::io::Error::other(reason));
    if let Some(reason) = not_finite(model) {
        return Err(failed(reason));
    }
    let body = body(model);
    let header = Header {
        inputs_sha256: inputs_sha256.to_owned(),
        settings: settings.clone(),
        state: state.clone(),
        tables: tables(model).map(table_header).collect(),
        deformation: model.deformation.as_ref().map(|weights| DeformationHeader {
            weights: weights.array.width,
            steps: weights.steps,
        }),
        pose_steps: model.poses.as_ref().map(|poses| poses.steps.clone()),
        body_sha256: store::sha256_bytes(&body),
    };
    let header = serde_json::to_string(&header).map_err(|error| failed(error.to_string()))?;
    store::write_with(path, |writer| {
        writeln!(writer, "{MAGIC}{VERSION}")?;
        writeln!(writer, "{header}")?;
        writer.write_all(&body)
    })
}

/// Reads the checkpoint of a run with these inputs and settings. `template` is the model with which
/// the run began: it says which tables and arrays there must be.
///
/// # Errors
/// When it is not the run's, or truncated, damaged or not finite.
pub fn read(
    path: &Path,
    inputs_sha256: &str,
    settings: &TrainSettings,
    template: &Model,
) -> Result<Checkpoint, Refusal> {
    let bytes =
        fs::read(path).map_err(|source| Refusal::Damaged(StoreError::read(path, source)))?;
    let damaged = |reason: String| {
        Refusal::Damaged(StoreError::malformed(
            path,
            format!("{reason}; remove it to begin anew"),
        ))
    };
    let (header, body) = split(&bytes).map_err(damaged)?;
    let header: Header = serde_json::from_str(header)
        .map_err(|error| damaged(format!("its header is not readable: {error}")))?;
    if header.inputs_sha256 != inputs_sha256 {
        return Err(Refusal::OtherRun(
            "it is of another scene, split or request".to_owned(),
        ));
    }
    let is_alike = header.tables.len() == tables(template).count()
        && tables(template)
            .zip(&header.tables)
            .all(|(table, header)| table_header(table).arrays == header.arrays)
        && header.deformation.map(|header| header.weights)
            == template
                .deformation
                .as_ref()
                .map(|weights| weights.array.width)
        && header.pose_steps.as_ref().map(Vec::len)
            == template.poses.as_ref().map(|poses| poses.steps.len());
    if header.settings != *settings || !is_alike {
        return Err(Refusal::OtherRun("its settings differ".to_owned()));
    }
    let expected =
        body_bytes(&header).ok_or_else(|| damaged("its header is not possible".to_owned()))?;
    if body.len() != expected {
        return Err(damaged(format!(
            "is truncated: {} of {expected} bytes of Gaussians",
            body.len()
        )));
    }
    if store::sha256_bytes(body) != header.body_sha256 {
        return Err(damaged(
            "is damaged: its content is not what was written".to_owned(),
        ));
    }
    let model = parse_body(body, &header, template);
    if let Some(reason) = not_finite(&model) {
        return Err(damaged(reason));
    }
    Ok(Checkpoint {
        state: header.state,
        model,
    })
}

/// The header's JSON and the body.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    let line_end = |bytes: &[u8]| bytes.iter().position(|&byte| byte == b'\n');
    let not_one = || "is not a checkpoint".to_owned();
    let first = line_end(bytes).ok_or_else(not_one)?;
    let version = std::str::from_utf8(&bytes[..first])
        .ok()
        .and_then(|line| line.strip_prefix(MAGIC))
        .ok_or_else(not_one)?;
    if version != VERSION {
        return Err(format!(
            "is a checkpoint of version {version}, expected {VERSION}"
        ));
    }
    let rest = &bytes[first + 1..];
    let second = line_end(rest).ok_or("is truncated: its header does not end")?;
    let header =
        std::str::from_utf8(&rest[..second]).map_err(|_| "its header is not UTF-8".to_owned())?;
    Ok((header, &rest[second + 1..]))
}

fn array_header(array: &ParameterArray) -> ArrayHeader {
    ArrayHeader {
        name: array.name.to_owned(),
        width: array.width,
    }
}

fn table_header(table: &ParameterTable) -> TableHeader {
    TableHeader {
        gaussians: table.len(),
        arrays: table.arrays.iter().map(array_header).collect(),
    }
}

/// The static Gaussians, then the moving ones.
fn tables(model: &Model) -> impl Iterator<Item = &ParameterTable> {
    let moving = model.moving.iter().map(|moving| &moving.table);
    std::iter::once(&model.table).chain(moving)
}

/// Length of the body; `None` where no memory could hold it.
fn body_bytes(header: &Header) -> Option<usize> {
    let weights = header.deformation.map_or(0, |header| header.weights);
    let poses = header.pose_steps.as_ref().map_or(0, Vec::len);
    // Values and two moments each.
    let mut words = weights.checked_add(poses.checked_mul(6)?)?.checked_mul(3)?;
    for (number, table) in header.tables.iter().enumerate() {
        let values: usize = table.arrays.iter().map(|array| array.width).sum();
        // Sums and views; the time gradients of moving Gaussians too.
        let statistics = if number == 0 { 2 } else { 3 };
        let of_table = table.gaussians.checked_mul(3 * values + statistics)?;
        words = words.checked_add(of_table)?;
    }
    words.checked_mul(size_of::<f32>())
}

fn body(model: &Model) -> Vec<u8> {
    let mut body = Vec::new();
    push_table(&mut body, &model.table, &model.statistics);
    if let Some(moving) = &model.moving {
        push_table(&mut body, &moving.table, &moving.statistics);
        push_floats(&mut body, &moving.time_gradients);
    }
    if let Some(weights) = &model.deformation {
        push_array(&mut body, &weights.array);
    }
    for array in model.poses.iter().flat_map(|poses| &poses.table.arrays) {
        push_array(&mut body, array);
    }
    body
}

fn push_table(body: &mut Vec<u8>, table: &ParameterTable, statistics: &Statistics) {
    for array in &table.arrays {
        push_array(body, array);
    }
    push_floats(body, &statistics.sums);
    let views = statistics.views.iter();
    body.extend(views.flat_map(|views| views.to_le_bytes()));
}

fn push_array(body: &mut Vec<u8>, array: &ParameterArray) {
    for column in [&array.values, &array.first_moments, &array.second_moments] {
        push_floats(body, column);
    }
}

fn push_floats(body: &mut Vec<u8>, values: &[f32]) {
    body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
}

/// `body` has the length that `header` asks for, and its tables have the arrays of `template`.
fn parse_body(body: &[u8], header: &Header, template: &Model) -> Model {
    let mut words = Words(body.as_chunks::<4>().0.iter());
    let mut parts = tables(template).zip(&header.tables).map(|(table, header)| {
        let gaussians = header.gaussians;
        let table = words.table(gaussians, table);
        let sums = words.floats(gaussians);
        let views = words.take(gaussians).map(u32::from_le_bytes).collect();
        (table, Statistics { sums, views })
    });
    let (table, statistics) = parts.next().unwrap_or_default();
    let moving = parts.next();
    drop(parts);
    let moving = moving.map(|(table, statistics)| MovingGaussians {
        time_gradients: words.floats(table.len()),
        table,
        statistics,
    });
    let deformation = header.deformation.map(|header| words.deformation(header));
    let poses = template.poses.as_ref().zip(header.pose_steps.as_ref());
    Model {
        table,
        statistics,
        moving,
        deformation,
        poses: poses.map(|(poses, steps)| {
            poses.with_values(words.table(steps.len(), &poses.table), steps.clone())
        }),
    }
}

/// What is left of a body.
struct Words<'a>(std::slice::Iter<'a, [u8; 4]>);

impl Words<'_> {
    fn take(&mut self, count: usize) -> impl Iterator<Item = [u8; 4]> {
        self.0.by_ref().take(count).copied()
    }

    fn floats(&mut self, count: usize) -> Vec<f32> {
        self.take(count).map(f32::from_le_bytes).collect()
    }

    fn deformation(&mut self, header: DeformationHeader) -> DeformationWeights {
        let mut weights = DeformationWeights::new(self.floats(header.weights));
        weights.array.first_moments = self.floats(header.weights);
        weights.array.second_moments = self.floats(header.weights);
        weights.steps = header.steps;
        weights
    }

    fn table(&mut self, gaussians: usize, template: &ParameterTable) -> ParameterTable {
        let mut table = ParameterTable::new(gaussians);
        for array in &template.arrays {
            let count = gaussians * array.width;
            let added = table.add(array.name, array.width, self.floats(count), 0.0);
            table.arrays[added].first_moments = self.floats(count);
            table.arrays[added].second_moments = self.floats(count);
        }
        table
    }
}

/// The first value that is not finite, in words.
pub(super) fn not_finite(model: &Model) -> Option<String> {
    let first = |array: &ParameterArray| {
        [&array.values, &array.first_moments, &array.second_moments]
            .into_iter()
            .find_map(|column| column.iter().position(|value| !value.is_finite()))
    };
    let of_gaussians = tables(model)
        .flat_map(|table| &table.arrays)
        .find_map(|array| {
            let gaussian = first(array)? / array.width;
            Some(format!(
                "{} of Gaussian {gaussian} is not finite",
                array.name
            ))
        });
    let of_weights = model.deformation.iter().map(|weights| &weights.array);
    let of_poses = model.poses.iter().flat_map(|poses| &poses.table.arrays);
    of_gaussians.or_else(|| {
        of_weights.chain(of_poses).find_map(|array| {
            let number = first(array)?;
            Some(format!("number {number} of {} is not finite", array.name))
        })
    })
}

#[cfg(test)]
mod tests;
