//! Checkpoints: everything that training needs to go on as if it had never stopped.
//!
//! ```text
//! omnilife/checkpoint/1\n
//! {"inputs_sha256": ..., "settings": ..., "state": ..., "arrays": ..., "body_sha256": ...}\n
//! body: f32, little-endian; for each array its values, first and second moments; then the sums
//!       of the density statistics, and their views as u32
//! ```
//!
//! Gradients are not kept: every step overwrites them. On the processor a run that is continued
//! gives the same bits as one that was never interrupted, unless a time budget steers it.

use std::{fs, io::Write, path::Path, time::Duration};

use omnilife_schemas::store::{self, StoreError};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::{
    settings::TrainSettings,
    step::{Model, StepSums},
    trace::TracePoint,
};
use crate::{
    densify::Statistics,
    gaussians::{GaussianTable, ParameterArray},
};

const MAGIC: &str = "omnilife/checkpoint/";
const VERSION: &str = "1";

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
    gaussians: usize,
    arrays: Vec<ArrayHeader>,
    body_sha256: String,
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
    if let Some(reason) = not_finite(&model.table) {
        return Err(failed(reason));
    }
    let body = body(model);
    let header = Header {
        inputs_sha256: inputs_sha256.to_owned(),
        settings: settings.clone(),
        state: state.clone(),
        gaussians: model.table.len(),
        arrays: model.table.arrays.iter().map(array_header).collect(),
        body_sha256: store::sha256_bytes(&body),
    };
    let header = serde_json::to_string(&header).map_err(|error| failed(error.to_string()))?;
    store::write_with(path, |writer| {
        writeln!(writer, "{MAGIC}{VERSION}")?;
        writeln!(writer, "{header}")?;
        writer.write_all(&body)
    })
}

/// Reads the checkpoint of a run with these inputs and settings. `template` is the table with which
/// the run began: it says which arrays there must be.
///
/// # Errors
/// When it is not the run's, or truncated, damaged or not finite.
pub fn read(
    path: &Path,
    inputs_sha256: &str,
    settings: &TrainSettings,
    template: &GaussianTable,
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
    let arrays: Vec<ArrayHeader> = template.arrays.iter().map(array_header).collect();
    if header.settings != *settings || header.arrays != arrays {
        return Err(Refusal::OtherRun("its settings differ".to_owned()));
    }
    let values: usize = header.arrays.iter().map(|array| array.width).sum();
    let expected = (header.gaussians)
        .checked_mul((3 * values + 2) * size_of::<f32>())
        .ok_or_else(|| damaged("its header is not possible".to_owned()))?;
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
    let model = parse_body(body, header.gaussians, template);
    if let Some(reason) = not_finite(&model.table) {
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

fn body(model: &Model) -> Vec<u8> {
    let arrays = &model.table.arrays;
    let values: usize = arrays.iter().map(|array| 3 * array.values.len()).sum();
    let mut body = Vec::with_capacity((values + 2 * model.table.len()) * size_of::<f32>());
    for array in arrays {
        for column in [&array.values, &array.first_moments, &array.second_moments] {
            body.extend(column.iter().flat_map(|value| value.to_le_bytes()));
        }
    }
    let statistics = &model.statistics;
    body.extend(statistics.sums.iter().flat_map(|sum| sum.to_le_bytes()));
    body.extend(
        statistics
            .views
            .iter()
            .flat_map(|views| views.to_le_bytes()),
    );
    body
}

/// `body` has the length that `gaussians` and `template` ask for.
fn parse_body(body: &[u8], gaussians: usize, template: &GaussianTable) -> Model {
    let mut words = body.as_chunks::<4>().0.iter();
    let mut floats = |count: usize| -> Vec<f32> {
        let column = words.by_ref().take(count);
        column.map(|&word| f32::from_le_bytes(word)).collect()
    };
    let mut table = GaussianTable::new(gaussians);
    for array in &template.arrays {
        let count = gaussians * array.width;
        let added = table.add(array.name, array.width, floats(count), 0.0);
        table.arrays[added].first_moments = floats(count);
        table.arrays[added].second_moments = floats(count);
    }
    let sums = floats(gaussians);
    let views = words.map(|&word| u32::from_le_bytes(word)).collect();
    Model {
        table,
        statistics: Statistics { sums, views },
    }
}

/// The first value that is not finite, in words.
pub(super) fn not_finite(table: &GaussianTable) -> Option<String> {
    table.arrays.iter().find_map(|array| {
        [&array.values, &array.first_moments, &array.second_moments]
            .into_iter()
            .find_map(|column| column.iter().position(|value| !value.is_finite()))
            .map(|index| {
                format!(
                    "{} of Gaussian {} is not finite",
                    array.name,
                    index / array.width
                )
            })
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;
    use crate::{
        gaussians::static_gaussians::{self, InitialGaussians, POSITIONS},
        methods::odgs,
    };

    fn model() -> Model {
        Model::new(static_gaussians::table(
            &InitialGaussians {
                positions: vec![[1.0, 2.0, 3.0]; 4],
                scales: vec![0.5; 4],
                colours: vec![[0.5; 3]; 4],
                opacities: vec![0.5; 4],
            },
            1,
        ))
    }

    fn state() -> LoopState {
        LoopState {
            iteration: 7,
            random: Pcg64Mcg::seed_from_u64(u64::MAX),
            queue: vec![2, 0, 1],
            last_reset: 3,
            training: Duration::from_nanos(1_234_567_891),
            evaluation: Duration::from_millis(5),
            training_cpu: Some(Duration::from_millis(7)),
            since_trace: StepSums {
                steps: 7,
                loss: 0.1 + 0.2,
                squared_error: 1e-300,
                refused: vec![0, 3],
            },
            refused: vec![1],
            trace: Vec::new(),
            resumed: 2,
        }
    }

    #[test]
    fn what_is_written_is_read_back_to_the_bit() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("checkpoint.bin");
        let settings = odgs::published_settings(30_000);
        let mut written = model();
        written.table.arrays[2].second_moments[5] = f32::MIN_POSITIVE / 3.0;
        written.statistics.views[1] = u32::MAX;
        write(&path, "inputs", &settings, &state(), &written)?;
        let read = read(&path, "inputs", &settings, &model().table);
        let Ok(read) = read else {
            panic!("{:?}", read.map(drop));
        };
        assert_eq!((read.state, read.model), (state(), written));
        Ok(())
    }

    #[test]
    fn a_value_that_is_not_finite_is_neither_written_nor_read()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("checkpoint.bin");
        let settings = odgs::published_settings(30_000);
        let mut poisoned = model();
        poisoned.table.arrays[POSITIONS].first_moments[10] = f32::NAN;
        let refused = write(&path, "inputs", &settings, &state(), &poisoned);
        let message = refused.expect_err("poisoned").to_string();
        assert!(
            message.contains("positions of Gaussian 3 is not finite"),
            "{message}"
        );
        assert!(!path.exists());

        // Somebody else wrote it, with a hash that is right.
        write(&path, "inputs", &settings, &state(), &model())?;
        let bytes = fs::read(&path)?;
        let (header, healthy) = split(&bytes)?;
        let sick = body(&poisoned);
        let header = header.replace(&store::sha256_bytes(healthy), &store::sha256_bytes(&sick));
        fs::write(
            &path,
            [format!("{MAGIC}{VERSION}\n{header}\n").as_bytes(), &sick].concat(),
        )?;
        match read(&path, "inputs", &settings, &model().table) {
            Err(Refusal::Damaged(error)) => {
                let message = error.to_string();
                assert!(message.contains("positions of Gaussian 3"), "{message}");
            }
            other => panic!("{:?}", other.map(drop)),
        }
        Ok(())
    }
}
