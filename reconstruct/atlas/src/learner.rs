//! Training of an atlas: batches of rays, phases, checkpoints.

use std::path::Path;

use glam::DVec3;
use omnilife_engine::{
    EngineError,
    camera::{Camera, View},
    model::{TrainedArray, saved::LoadError},
    parameters::SharedParameters,
    schedule::Position,
    step::{StepStatistics, gpu::memory::DevicePlan},
};
use omnilife_schemas::{RgbImage, records::Backend};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::{
    clip::{Clip, camera_direction, pixel_centre},
    device::AtlasDevice,
    graph::{ARRAYS, Graph, Visibility},
    node::FieldKind,
    published::Plateau,
    render::{Moment, Rays},
    saved,
    settings::Settings,
    step::Targets,
};
use omnilife_training::{
    error::ReconstructError,
    learner::{Learner, ModelSize, SavedLearner},
    random::{Purpose, stream},
};

/// Minimum share of rays without a hit for a warning.
const MANY_MISSED: f64 = 1e-3;

/// An atlas with its training state.
#[derive(Debug)]
pub struct AtlasLearner {
    clip: Clip,
    graph: Graph,
    settings: Settings,
    /// Unit directions of the pixels' centres, camera.
    directions: Vec<DVec3>,
    /// For rows of different sizes: cumulative shares, from which a random number picks a row.
    row_shares: Vec<f64>,
    state: State,
    statistics: StepStatistics,
    iteration: u64,
    /// `None` on the CPU.
    device: Option<AtlasDevice>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct State {
    rays: Pcg64Mcg,
    missed: u64,
    seen: u64,
    samples: u64,
    plateau: Plateau,
}

#[derive(Serialize, Deserialize)]
struct Header {
    settings: Settings,
    state: State,
    /// Steps and number of values of each array.
    arrays: Vec<(u64, usize)>,
}

impl AtlasLearner {
    /// Makes a learner before its first step.
    pub fn new(clip: Clip, graph: Graph, settings: Settings) -> Self {
        let [width, height] = clip.size();
        let directions = (0..width * height)
            .map(|pixel| camera_direction(&clip.camera, pixel_centre(pixel, width)))
            .collect();
        let solid = |row: usize| match clip.camera {
            Camera::Erp(camera) => camera.pixel_solid_angle(row as u32),
            Camera::Pinhole(_) => 1.0,
        };
        let all: f64 = (0..height).map(solid).sum();
        let row_shares = (0..height)
            .scan(0.0, |sum, row| {
                *sum += solid(row) / all;
                Some(*sum)
            })
            .collect();
        Self {
            state: State {
                rays: stream(settings.seed, Purpose::Rays),
                missed: 0,
                seen: 0,
                samples: 0,
                plateau: Plateau::default(),
            },
            clip,
            graph,
            settings,
            directions,
            row_shares,
            statistics: StepStatistics::default(),
            iteration: 0,
            device: None,
        }
    }

    /// Moves its steps and images to the first GPU.
    ///
    /// # Errors
    /// If no GPU answers.
    pub fn move_to_gpu(&mut self) -> Result<(), EngineError> {
        let room = [self.settings.rays, self.clip.frames.len()];
        self.device = Some(AtlasDevice::open(room)?);
        Ok(())
    }

    /// Copies the parameters to the host if those of a device are newer.
    fn download(&mut self) -> Result<(), EngineError> {
        match &mut self.device {
            Some(device) => device.download(&mut self.graph),
            None => Ok(()),
        }
    }

    /// Returns the atlas for reading and changes, from which the next step continues.
    ///
    /// # Errors
    /// If the device fails.
    pub fn graph(&mut self) -> Result<&mut Graph, EngineError> {
        self.download()?;
        if let Some(device) = &mut self.device {
            device.forget();
        }
        Ok(&mut self.graph)
    }

    /// Returns the number of hits of nodes so far.
    pub fn samples(&self) -> u64 {
        self.state.samples
    }

    /// Draws a frame and a pixel of its scene, evenly over the directions of an image.
    fn random_pixel(&mut self) -> [usize; 2] {
        let [width, height] = self.clip.size();
        loop {
            let number = self.state.rays.random_range(0..self.clip.frames.len());
            let share: f64 = self.state.rays.random();
            let row = self.row_shares.partition_point(|&end| end < share);
            let column = self.state.rays.random_range(0..width);
            let pixel = row.min(height - 1) * width + column;
            // Every frame has such pixels, so that the loop ends.
            if self.clip.frames[number].shows_scene(pixel) {
                return [number, pixel];
            }
        }
    }

    /// Draws rays at random pixels of random frames, evenly over the directions of an image.
    fn batch(&mut self) -> (Rays, Targets) {
        let objects = self.clip.objects.len();
        let count = self.settings.rays;
        let mut rays = Rays {
            moments: self
                .clip
                .frames
                .iter()
                .map(|frame| Moment {
                    time: frame.time,
                    given: frame.pose,
                })
                .collect(),
            moment_of: Vec::with_capacity(count),
            directions: Vec::with_capacity(count),
        };
        let mut targets = Targets::default();
        let is_masked = self.settings.mask_weight > 0.0;
        for _ in 0..count {
            let [number, pixel] = self.random_pixel();
            let frame = &self.clip.frames[number];
            rays.moment_of.push(number);
            rays.directions.push(self.directions[pixel]);
            targets.colours.push(DVec3::from_array(frame.colour(pixel)));
            if !is_masked {
                continue;
            }
            let front = (0..objects).find(|&object| frame.covered(object, pixel) >= 0.5);
            for object in 0..objects {
                let is_hidden = !self.settings.published.mask_loss
                    && front.is_some_and(|front| front != object);
                targets
                    .covered
                    .push((!is_hidden).then(|| frame.covered(object, pixel)));
            }
        }
        (rays, targets)
    }

    fn parameters(&mut self) -> Vec<&mut SharedParameters> {
        let mut all = Vec::new();
        for node in &mut self.graph.nodes {
            let fields = &mut node.fields;
            let slots = [
                &mut fields.colour,
                &mut fields.opacity,
                &mut fields.flow,
                &mut fields.view,
            ];
            for field in slots.into_iter().flatten() {
                all.push(&mut field.table);
                all.push(&mut field.weights);
            }
            if let Some(offsets) = &mut node.offsets {
                all.push(&mut offsets.parameters);
            }
        }
        if let Some(offsets) = &mut self.graph.camera {
            all.push(&mut offsets.parameters);
        }
        all
    }
}

impl Learner for AtlasLearner {
    fn backend(&self) -> Backend {
        match &self.device {
            Some(device) => device.record(),
            None => Backend::Cpu {
                threads: rayon::current_num_threads() as u32,
            },
        }
    }

    fn size(&self) -> ModelSize {
        let nodes = self.graph.nodes.iter();
        let objects = nodes.filter(|node| node.opacity.is_some()).count() as u64;
        let values: usize = self.graph.parameter_counts().iter().sum();
        ModelSize {
            primitives: self.graph.nodes.len() as u64,
            with_times: objects,
            objects: Some(objects),
            bytes: 16 * values as u64,
        }
    }

    fn device_plan(&self) -> Result<Option<DevicePlan>, EngineError> {
        let plan = self.device.as_ref().map(|device| device.plan(&self.graph));
        plan.transpose()
    }

    fn arrays(&self) -> Vec<TrainedArray> {
        let counts = self.graph.parameter_counts();
        let arrays = ARRAYS.iter().zip(counts);
        arrays
            .map(|(name, values)| TrainedArray { name, values })
            .collect()
    }

    /// Makes a step on rays of all views; the drawn view has no effect.
    fn step(&mut self, _view: usize, at: &Position) -> Result<(), EngineError> {
        self.iteration = at.iteration;
        let detail = self.settings.detail(at);
        let rates = self.settings.rates(at, &self.state.plateau);
        let (rays, targets) = self.batch();
        let outcome = match &mut self.device {
            Some(device) => device.step(&mut self.graph, (&rays, &targets), &detail, &rates)?,
            None => self.graph.step(&rays, &targets, &detail, &rates),
        };
        if !outcome.loss.is_finite() {
            return Err(EngineError::Diverged {
                iteration: at.iteration,
                what: "the loss is not finite".to_owned(),
            });
        }
        self.state.plateau.add(at.share, outcome.loss);
        self.state.missed += outcome.missed as u64;
        self.state.samples += outcome.samples as u64;
        self.state.seen += rays.directions.len() as u64;
        self.statistics.add(&StepStatistics {
            steps: 1,
            loss: outcome.loss,
            squared_error: outcome.squared_error,
            refused: outcome.refused.to_vec(),
        });
        Ok(())
    }

    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError> {
        let mut statistics = std::mem::take(&mut self.statistics);
        if let Some(device) = &mut self.device {
            statistics.add(&StepStatistics {
                refused: device.take_refused()?.to_vec(),
                ..StepStatistics::default()
            });
        }
        Ok(statistics)
    }

    fn image(&mut self, view: &View) -> Result<RgbImage, EngineError> {
        match &mut self.device {
            Some(device) => device.image(&self.graph, view),
            None => Ok(self.graph.image(view, &Visibility::All).0),
        }
    }

    fn save(&mut self) -> Result<SavedLearner, EngineError> {
        self.download()?;
        if let Some(what) = self.graph.not_finite() {
            return Err(EngineError::Diverged {
                iteration: self.iteration,
                what,
            });
        }
        let mut body = Vec::new();
        let mut arrays = Vec::new();
        for parameters in self.parameters() {
            arrays.push((parameters.steps, parameters.array.values.len()));
            let array = &parameters.array;
            for values in [&array.values, &array.first_moments, &array.second_moments] {
                body.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            }
        }
        let header = Header {
            settings: self.settings.clone(),
            state: self.state.clone(),
            arrays,
        };
        let header = serde_json::to_string(&header).map_err(|error| EngineError::Backend {
            reason: format!("the checkpoint's header: {error}"),
        })?;
        Ok(SavedLearner { header, body })
    }

    fn restore(&mut self, saved: &SavedLearner) -> Result<(), LoadError> {
        let header: Header = serde_json::from_str(&saved.header)
            .map_err(|error| LoadError::Damaged(format!("its header is not readable: {error}")))?;
        let lengths: Vec<usize> = self
            .parameters()
            .iter()
            .map(|p| p.array.values.len())
            .collect();
        let is_alike = header.settings == self.settings
            && header
                .arrays
                .iter()
                .map(|&(_, len)| len)
                .eq(lengths.iter().copied());
        if !is_alike {
            return Err(LoadError::Other);
        }
        let (words, rest) = saved.body.as_chunks::<4>();
        if words.len() != 3 * lengths.iter().sum::<usize>() || !rest.is_empty() {
            return Err(LoadError::Damaged("is truncated".to_owned()));
        }
        let mut words = words.iter().map(|word| f32::from_le_bytes(*word));
        for (parameters, (steps, _)) in self.parameters().into_iter().zip(&header.arrays) {
            parameters.steps = *steps;
            let array = &mut parameters.array;
            for values in [
                &mut array.values,
                &mut array.first_moments,
                &mut array.second_moments,
            ] {
                values.fill_with(|| words.next().unwrap_or(f32::NAN));
            }
        }
        self.state = header.state;
        if let Some(device) = &mut self.device {
            device.forget();
        }
        self.graph
            .not_finite()
            .map_or(Ok(()), |reason| Err(LoadError::Damaged(reason)))
    }

    fn export(&mut self, folder: &Path) -> Result<Vec<String>, ReconstructError> {
        self.download()?;
        Ok(saved::write(folder, &self.graph)?)
    }

    fn begins_with_points(&self) -> bool {
        false
    }

    fn warnings(&self) -> Vec<String> {
        let share = self.state.missed as f64 / self.state.seen.max(1) as f64;
        let mut warnings = Vec::new();
        if share > MANY_MISSED {
            warnings.push(format!(
                "{:.2} % of the rays hit nothing and stay black",
                100.0 * share
            ));
        }
        let never = self.graph.nodes.iter().filter(|node| {
            let colour = node.fields.get(FieldKind::Colour);
            colour.is_some_and(|field| field.weights.steps == 0) && self.state.seen > 0
        });
        warnings.extend(never.map(|node| format!("no ray ever hit the node {}", node.id)));
        warnings
    }
}
