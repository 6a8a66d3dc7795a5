//! Setup of a case: raw Gaussians and a view, in f64.

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_schemas::{
    Pose, Similarity,
    camera::{ErpCamera, PinholeCamera},
};

use omnilife_engine::{
    camera::{Camera, View},
    clock::Clock,
    gaussians::parameterization::Viewpoint,
    render::{
        reference::RefView,
        settings::{Footprint, RenderSettings},
    },
};

/// Raw parameters of a Gaussian, before any parameterization has rounded them to f32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RawGaussian {
    /// Centre, normalized units.
    pub position: [f64; 3],
    /// Natural logarithms of the standard deviations.
    pub log_scale: [f64; 3],
    /// (w, x, y, z), of any length.
    pub quaternion: [f64; 4],
    /// Logit of the opacity.
    pub opacity_logit: f64,
    /// Constant coefficients of colour.
    pub sh: [f64; 3],
    /// Motion and lifespan; parameterizations without time ignore it.
    pub motion: Motion,
}

/// A Gaussian in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Time of its highest opacity, seconds.
    pub peak_seconds: f64,
    /// Standard deviation of its opacity over time, seconds.
    pub lifespan_seconds: f64,
    /// Normalized units per second.
    pub velocity: [f64; 3],
}

impl Motion {
    /// Slow motion and a lifespan of about a clip.
    pub const MILD: Self = Self {
        peak_seconds: 0.4,
        lifespan_seconds: 2.0,
        velocity: [0.05, -0.02, 0.03],
    };
}

impl RawGaussian {
    /// Returns a Gaussian in a direction from the origin with some rotation; the colour depends on `number`.
    pub fn new(
        direction: DVec3,
        distance: f64,
        scale: [f64; 3],
        opacity: f64,
        number: usize,
    ) -> Self {
        let hue = number as f64;
        Self {
            position: (direction.normalize() * distance).to_array(),
            log_scale: scale.map(f64::ln),
            quaternion: [0.8, 0.3, -0.4, 0.33],
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
            sh: [hue, hue + 1.0, hue + 2.0].map(|phase| 0.9 * (1.7 * phase).sin() + 0.2),
            motion: Motion::MILD,
        }
    }
}

/// Units and settings of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Clock from seconds to frames.
    pub clock: Clock,
    /// Cycle of periodic motions, frames.
    pub cycle_frames: f32,
    /// Shift of the drawn state to earlier times, frames (temporal smoothing).
    pub shift_frames: f32,
}

impl Timing {
    /// A clip of ten frames in a second, which starts a little before 0.
    pub const MILD: Self = Self {
        clock: Clock {
            origin_seconds: 0.45,
            frame_seconds: 0.1,
            duration_frames: 10.0,
        },
        cycle_frames: 10.0,
        shift_frames: 0.0,
    };
}

/// A case before anything has been computed.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Gaussians of the case.
    pub gaussians: Vec<RawGaussian>,
    /// Indices of the Gaussians whose gradients are judged.
    pub judged: Vec<usize>,
    /// The exact view.
    pub exact: RefView,
    /// The view from the loader, for the kernels.
    pub view: View,
    /// Units and settings of its time.
    pub timing: Timing,
}

/// Instant of the view, seconds.
pub const TIME_SECONDS: f64 = 0.5;

impl Setup {
    /// Returns time and view of the Gaussians, in training.
    pub fn viewpoint(&self) -> Viewpoint {
        Viewpoint::of_step(&self.view, self.timing.shift_frames, 1)
    }

    /// Returns these Gaussians from a rotated camera.
    pub fn new(gaussians: Vec<RawGaussian>) -> Self {
        let turned = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2);
        Self::seen(gaussians, turned, dvec3(0.05, -0.02, 0.04), 48)
    }

    /// Returns these Gaussians from a straight camera at the origin.
    pub fn straight(gaussians: Vec<RawGaussian>) -> Self {
        Self::seen(gaussians, DQuat::IDENTITY, DVec3::ZERO, 48)
    }

    /// Returns these Gaussians from a camera with this camera-to-world rotation, in an image of this width.
    pub fn seen(gaussians: Vec<RawGaussian>, turn: DQuat, centre: DVec3, width: u32) -> Self {
        let identity = Similarity {
            offset: [0.0; 3],
            scale: 1.0,
        };
        Self::in_world(gaussians, turn, centre, width, identity)
    }

    /// Returns the same in a world of which `similarity` makes the normalized scene: the loader sees the world's
    /// numbers.
    pub fn in_world(
        gaussians: Vec<RawGaussian>,
        turn: DQuat,
        centre: DVec3,
        width: u32,
        similarity: Similarity,
    ) -> Self {
        let camera = Camera::Erp(ErpCamera {
            width,
            height: width / 2,
        });
        let settings = RenderSettings {
            background: [0.1, 0.3, 0.2],
            sh_degree: 0,
            ..RenderSettings::new(0.01)
        };
        let pose = Pose::new(turn, similarity.restore(centre));
        let exact = RefView {
            camera,
            rotation: DMat3::from_quat(turn).transpose(),
            centre,
            settings,
        };
        let view = View::new(camera, &pose, &similarity, TIME_SECONDS).unwrap_or(View {
            time_seconds: TIME_SECONDS,
            ..exact.view()
        });
        Self {
            judged: (0..gaussians.len()).collect(),
            gaussians,
            exact,
            view,
            timing: Timing::MILD,
        }
    }

    /// Returns the setup through a pinhole of 48x32 pixels with this horizontal field of view, degrees, and its
    /// principal point off the middle by some pixels.
    pub fn through(mut self, degrees: f64, [off_x, off_y]: [f64; 2]) -> Self {
        let camera = PinholeCamera::with_horizontal_field_of_view(48, 32, degrees.to_radians());
        let camera = Camera::Pinhole(PinholeCamera {
            cx: camera.cx + off_x,
            cy: camera.cy + off_y,
            ..camera
        });
        self.exact.camera = camera;
        self.view.camera = camera;
        self
    }

    /// Returns the setup with another definition of the falloff.
    pub fn with_footprint(mut self, footprint: Footprint) -> Self {
        self.exact.settings.footprint = footprint;
        self
    }

    /// Returns the setup with another cycle of periodic motions, frames.
    pub fn with_cycle(mut self, frames: f64) -> Self {
        self.timing.cycle_frames = frames as f32;
        self
    }

    /// Returns the setup at another time of another clip.
    pub fn at(mut self, seconds: f64, clock: Clock) -> Self {
        self.view.time_seconds = seconds;
        self.timing.clock = clock;
        self
    }
}

/// Returns mild Gaussians all around the origin.
pub fn mild() -> Vec<RawGaussian> {
    (0..10)
        .map(|index| {
            let y = 1.0 - (f64::from(index) + 0.5) / 5.0;
            let (sin, cos) = (2.399_963 * f64::from(index)).sin_cos();
            let rho = (1.0 - y * y).sqrt();
            let distance = 2.0 + 0.3 * f64::from(index);
            RawGaussian::new(
                dvec3(rho * cos, 0.8 * y, rho * sin),
                distance,
                [0.2, 0.3, 0.25],
                0.5,
                index as usize,
            )
        })
        .collect()
}
