//! A node of an atlas: a surface with a base texture and fields over it.
//!
//! ```text
//! q = uv + 0.1 S(t, F_flow(uv))        phi: the angle from the plane's normal to the ray
//! c = clamp( C0(q) + 0.1 F_c(q) + 0.1 F_view(q, phi) )
//! alpha = sigmoid( logit A0(q) + 0.1 F_alpha(q) + 0.1 F_view,alpha(q, phi) )
//! ```
//!
//! (Neural Atlas Graphs, supplement A.2 and A.4; `view_dependent_image_plane_scene_node_3d.py`.) A node
//! without a base opacity is opaque. On the sphere `uv` is a unit direction, the flow moves it along the
//! surface, and there is no view field.

use glam::DVec2;
use omnilife_engine::{
    fields::grid_field::GridField,
    parameters::SharedParameters,
    surfaces::{
        plane::{self, PlaneHit, Ray},
        sphere::{self, Sphere, SphereHit},
        texture::Texture,
    },
    trajectories::{
        catmull_rom::Knots,
        rigid_spline::{RigidOffsets, RigidPose, RigidSpline},
    },
};
use serde::{Deserialize, Serialize};

/// Weight of every field.
pub const FIELD_WEIGHT: f64 = 0.1;

/// Surface of a node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Surface {
    /// A rectangle on a rigid trajectory.
    Plane {
        /// Its sides, normalized units.
        size: DVec2,
        /// Its trajectory, without the trained correction.
        trajectory: RigidSpline,
    },
    /// The sphere around the cameras.
    Sphere {
        /// Its centre, normalized units.
        centre: glam::DVec3,
        /// Its radius.
        radius: f64,
    },
}

/// Hit of a node by a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Hit {
    /// A rectangle.
    Plane(PlaneHit),
    /// The sphere.
    Sphere(SphereHit),
}

impl Hit {
    /// Returns the distance along the ray.
    pub fn distance(&self) -> f64 {
        match self {
            Self::Plane(hit) => hit.distance,
            Self::Sphere(hit) => hit.distance,
        }
    }
}

/// Fields of a node; a field that is left out is 0.
#[derive(Debug, Default)]
pub struct Fields {
    /// Colour at a query.
    pub colour: Option<GridField>,
    /// Logit of opacity at a query.
    pub opacity: Option<GridField>,
    /// Control points of the flow at a hit.
    pub flow: Option<GridField>,
    /// Colour, and logit of opacity, at a query seen from an angle.
    pub view: Option<GridField>,
}

/// Kinds of fields, in the order in which they are trained, saved and named.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FieldKind {
    /// Colour.
    Colour,
    /// Opacity.
    Opacity,
    /// Flow.
    Flow,
    /// View.
    View,
}

impl FieldKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Colour, Self::Opacity, Self::Flow, Self::View];

    /// Returns its index in [`FieldKind::ALL`].
    pub fn number(self) -> usize {
        self as usize
    }
}

impl Fields {
    /// Returns the field of a kind.
    pub fn get(&self, kind: FieldKind) -> Option<&GridField> {
        self.slot(kind).as_ref()
    }

    fn slot(&self, kind: FieldKind) -> &Option<GridField> {
        match kind {
            FieldKind::Colour => &self.colour,
            FieldKind::Opacity => &self.opacity,
            FieldKind::Flow => &self.flow,
            FieldKind::View => &self.view,
        }
    }

    /// Returns the slot of a field.
    pub fn slot_mut(&mut self, kind: FieldKind) -> &mut Option<GridField> {
        match kind {
            FieldKind::Colour => &mut self.colour,
            FieldKind::Opacity => &mut self.opacity,
            FieldKind::Flow => &mut self.flow,
            FieldKind::View => &mut self.view,
        }
    }
}

/// Trained corrections of a trajectory, as Adam sees them: positions first, then rotation vectors.
#[derive(Debug)]
pub struct LearntOffsets {
    /// Length of an offset of 1.
    pub unit: f64,
    /// True if rotations are trained.
    pub with_rotation: bool,
    /// Three values per knot and kind.
    pub parameters: SharedParameters,
}

impl LearntOffsets {
    /// Returns offsets of 0 for so many knots on [0, 1].
    pub fn zero(inner: usize, unit: f64, with_rotation: bool) -> Self {
        let count = Knots::with_neighbours(inner).count;
        Self {
            unit,
            with_rotation,
            parameters: SharedParameters::new("trajectories", vec![0.0; 6 * count]),
        }
    }

    /// Returns the offsets of a trajectory.
    pub fn offsets(&self) -> RigidOffsets {
        let values = &self.parameters.array.values;
        let vectors = |values: &[f32]| -> Vec<glam::DVec3> {
            let triples = values.chunks_exact(3);
            triples
                .map(|v| glam::DVec3::new(v[0].into(), v[1].into(), v[2].into()))
                .collect()
        };
        let (positions, rotations) = values.split_at(values.len() / 2);
        RigidOffsets {
            unit: self.unit,
            positions: vectors(positions),
            vectors: vectors(rotations),
        }
    }
}

/// An image that replaces a node's colour.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// RGBA, [0, 1].
    pub texture: Texture<4>,
}

/// A node.
#[derive(Debug)]
pub struct Node {
    /// Name of the object, or `background`.
    pub id: String,
    /// Its surface.
    pub surface: Surface,
    /// Base colours.
    pub colour: Texture<3>,
    /// Base opacities, within (0, 1); none where the node is opaque.
    pub opacity: Option<Texture<1>>,
    /// Its fields over the surface.
    pub fields: Fields,
    /// Its trained corrections of the trajectory.
    pub offsets: Option<LearntOffsets>,
    /// Start and end of the node's existence, in [0, 1].
    pub times: [f64; 2],
    /// Delay of the node against its frames, in the same unit (an edit).
    pub delay: f64,
    /// An image painted on it (an edit).
    pub overlay: Option<Overlay>,
}

impl Node {
    /// Returns true if the node exists at a time.
    pub fn is_there(&self, time: f64) -> bool {
        // Half a millionth of the clip: less than a frame of any.
        const ROUNDING: f64 = 5e-7;
        let own = time - self.delay;
        own >= self.times[0] - ROUNDING && own <= self.times[1] + ROUNDING
    }

    /// Returns the given pose at a time; for the sphere that is its position alone.
    pub fn given_pose(&self, time: f64) -> RigidPose {
        match &self.surface {
            Surface::Plane { trajectory, .. } => trajectory.pose(time),
            Surface::Sphere { centre, .. } => RigidPose {
                centre: *centre,
                rotation: glam::DMat3::IDENTITY,
            },
        }
    }

    /// Returns the pose at a time, with its correction.
    pub fn pose(&self, time: f64) -> RigidPose {
        let own = time - self.delay;
        let given = self.given_pose(own);
        match &self.offsets {
            Some(offsets) => offsets.offsets().applied(&given, own),
            None => given,
        }
    }

    /// Intersects a ray with the node at a pose.
    pub fn hit(&self, ray: &Ray, pose: &RigidPose) -> Option<Hit> {
        match &self.surface {
            Surface::Plane { size, .. } => plane::hit(ray, pose, *size).map(Hit::Plane),
            Surface::Sphere { radius, .. } => {
                let sphere = Sphere {
                    centre: pose.centre,
                    radius: *radius,
                };
                sphere::hit(ray, &sphere).map(Hit::Sphere)
            }
        }
    }

    /// Returns the number of coordinates of the surface: 2 on a plane, 3 on the sphere.
    pub fn dimensions(&self) -> usize {
        match self.surface {
            Surface::Plane { .. } => 2,
            Surface::Sphere { .. } => 3,
        }
    }

    /// Returns the control points of its flow, without the one beyond each end.
    pub fn flow_points(&self) -> Option<usize> {
        let flow = self.fields.flow.as_ref()?;
        Some(flow.shape().outputs / self.dimensions() - 2)
    }

    /// Returns the number of trained values of each kind: of fields in the order of [`FieldKind::ALL`], then of
    /// the trajectory.
    pub fn parameter_counts(&self) -> [usize; 5] {
        let mut counts = [0; 5];
        for kind in FieldKind::ALL {
            let field = self.fields.get(kind);
            counts[kind.number()] = field.map_or(0, |field| field.shape().parameter_count());
        }
        let offsets = self.offsets.as_ref();
        counts[4] = offsets.map_or(0, |offsets| offsets.parameters.array.values.len());
        counts
    }
}
