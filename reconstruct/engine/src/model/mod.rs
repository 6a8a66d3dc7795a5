//! What training changes: tables of Gaussians, a network, corrections of poses.

pub mod cpu_renderer;
pub mod deformation_settings;
pub mod dynamic_settings;
pub mod exposure;
pub mod layers;
pub mod pose_corrections;

use glam::Vec3;

use self::{dynamic_settings::DynamicSettings, pose_corrections::PoseCorrections};
use crate::{
    camera::View,
    gaussians::{
        InstantGaussians,
        deformable::DeformationWeights,
        static_gaussians,
        temporal::{Look, TemporalFeatures},
    },
    parameters::{ArrayShape, ParameterTable},
    render::Visible,
};

/// What training changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Parameters of the static Gaussians with their moments.
    pub table: ParameterTable,
    /// What their density control goes by.
    pub statistics: Statistics,
    /// Gaussians that depend on time; static methods have none.
    pub moving: Option<MovingGaussians>,
    /// A network that deforms the static Gaussians; most methods have none.
    pub deformation: Option<DeformationWeights>,
    /// Corrections of the input views' poses, where they are refined.
    pub poses: Option<PoseCorrections>,
}

/// Gaussians that depend on time. Their table has the static ones' arrays first.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingGaussians {
    /// Parameters with their moments.
    pub table: ParameterTable,
    /// What density control in space goes by.
    pub statistics: Statistics,
    /// What density control in time goes by: sums of `|dL/dtau|` over the views that saw a Gaussian.
    pub time_gradients: Vec<f32>,
}

impl Model {
    /// A model at the beginning of its training.
    pub fn new(table: ParameterTable) -> Self {
        Self {
            statistics: Statistics::new(table.len()),
            table,
            moving: None,
            deformation: None,
            poses: None,
        }
    }

    /// A model with Gaussians that depend on time, at the beginning of its training.
    pub fn with_moving(table: ParameterTable, moving: ParameterTable) -> Self {
        Self {
            moving: Some(MovingGaussians::new(moving)),
            ..Self::new(table)
        }
    }

    /// Number of Gaussians, static and moving.
    pub fn len(&self) -> usize {
        let moving = self.moving.as_ref().map_or(0, |moving| moving.table.len());
        self.table.len() + moving
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A view of the scene with the pose that it is trained and shown with.
    pub fn corrected(&self, view: &View) -> View {
        match &self.poses {
            Some(poses) => poses.apply(view),
            None => *view,
        }
    }

    /// Names and widths of all arrays: those of static Gaussians, those that only moving ones have,
    /// the weights of a network, a single row, and the corrections of poses.
    pub fn shapes(&self) -> Vec<ArrayShape> {
        let widest = self
            .moving
            .as_ref()
            .map_or(&self.table, |moving| &moving.table);
        let mut shapes = widest.shapes();
        shapes.extend(self.deformation.as_ref().map(|weights| ArrayShape {
            name: weights.array.name,
            width: weights.array.width,
        }));
        shapes.extend(self.poses.iter().flat_map(|poses| poses.table.shapes()));
        shapes
    }
}

impl MovingGaussians {
    /// At the beginning of training.
    pub fn new(table: ParameterTable) -> Self {
        Self {
            statistics: Statistics::new(table.len()),
            time_gradients: vec![0.0; table.len()],
            table,
        }
    }

    /// Begins the statistics anew.
    pub fn forget_statistics(&mut self) {
        self.statistics = Statistics::new(self.table.len());
        self.time_gradients = vec![0.0; self.table.len()];
    }
}

impl From<ParameterTable> for Model {
    fn from(table: ParameterTable) -> Self {
        Self::new(table)
    }
}

/// Image-space gradients since the last densification.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Statistics {
    /// Sum over the views that saw the Gaussian of the length of its centre's gradient, in
    /// normalized device coordinates.
    pub sums: Vec<f32>,
    /// How many views saw it.
    pub views: Vec<u32>,
}

impl Statistics {
    /// Nothing seen yet, for `len` Gaussians.
    pub fn new(len: usize) -> Self {
        Self {
            sums: vec![0.0; len],
            views: vec![0; len],
        }
    }

    /// Adds the visible Gaussians of one view; `half_size` is half the image's width and height.
    pub fn add(&mut self, visible: impl Iterator<Item = Visible>, half_size: [f32; 2]) {
        for visible in visible {
            let index = visible.gaussian;
            let [u, v] = visible.centre_gradient;
            self.sums[index] += (u * half_size[0]).hypot(v * half_size[1]);
            self.views[index] += 1;
        }
    }

    pub(crate) fn mean(&self, index: usize) -> f32 {
        self.sums[index] / self.views[index].max(1) as f32
    }
}

/// All Gaussians of a model at one moment: the static ones, then the moving ones.
pub fn instantiate(
    model: &Model,
    settings: &DynamicSettings,
    look: &Look,
    features: &TemporalFeatures,
    out: &mut InstantGaussians,
) {
    let fixed = model.table.len();
    let moving = model.moving.as_ref().map_or(0, |moving| moving.table.len());
    let degree = static_gaussians::sh_degree(&model.table);
    out.reshape(fixed + moving, degree, features.count());
    static_gaussians::instantiate_from(&model.table, 0, out);
    if features.count() > 0 {
        for row in out.features.chunks_mut(features.count()).take(fixed) {
            features.write(Vec3::ZERO, f32::INFINITY, row);
        }
    }
    if let Some(moving) = &model.moving {
        let time = &settings.time;
        time.instantiate_from(&moving.table, look, features, fixed, out);
    }
}
