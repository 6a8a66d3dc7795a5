//! Appearance of a node at its hits, and its gradients.

mod places;

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use omnilife_engine::{
    fields::grid_field::GridField,
    surfaces::{
        gpu::SurfaceSample,
        plane::{self, PlaneGradient, Ray},
        sphere::{self, Sphere},
        texture::{TextureEdge, direction_gradient},
        view_angle::{view_angle, view_angle_vjp},
    },
    trajectories::{
        catmull_rom::{KnotWeights, Knots},
        rigid_spline::RigidPose,
    },
};
use rayon::prelude::*;

use self::places::{
    add_coordinates, coordinate_scale, coordinates, moved, moved_vjp, place, spline_of,
    view_coordinates,
};
use super::node::{FIELD_WEIGHT, FieldKind, Hit, Node, Surface};

/// A hit of a node by a ray of a batch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Number of the ray.
    pub ray: usize,
    /// Number of the moment, for poses and splines that all samples of a moment share.
    pub moment: usize,
    /// Position of the hit.
    pub hit: Hit,
}

/// Evaluated fields, and their level of detail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detail {
    /// True for each evaluated kind of field, in the order of [`FieldKind::ALL`].
    pub kinds: [bool; 4],
    /// Share of the features of flow and view that is used (coarse to fine).
    pub active_share: f64,
}

impl Detail {
    /// All fields at full detail.
    pub const FULL: Self = Self {
        kinds: [true; 4],
        active_share: 1.0,
    };

    /// Returns the number of a field's features that are used.
    pub(super) fn active(&self, kind: FieldKind, field: &GridField) -> usize {
        let features = field.features();
        match kind {
            FieldKind::Colour | FieldKind::Opacity => features,
            FieldKind::Flow | FieldKind::View => {
                // Not one more for the last bit of a product.
                (self.active_share * features as f64 - 1e-9).ceil() as usize
            }
        }
    }
}

/// Appearance of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shade {
    /// Colour, [0, 1].
    pub colour: DVec3,
    /// Opacity, [0, 1].
    pub opacity: f64,
    /// Query of the textures: `uv` followed by 0, or a unit direction.
    pub query: DVec3,
    /// The colour before it is clamped.
    unclamped: DVec3,
    /// Derivatives of the base textures by the query: of each channel, then of the logit.
    by_query: [DVec3; 4],
    /// Output of the flow field on the sphere, before it is projected.
    flow: DVec3,
}

/// Appearance of samples, with the inputs of their gradients.
#[derive(Debug)]
pub struct Shading {
    /// One for each sample.
    pub shades: Vec<Shade>,
    /// Control points of the flow at each moment.
    flow_weights: Vec<KnotWeights>,
    /// The evaluated kinds of fields.
    evaluated: [bool; 4],
}

/// Gradients by the appearance of samples.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ShadeGradient {
    /// Gradient by the colour.
    pub colour: DVec3,
    /// Gradient by the opacity.
    pub opacity: f64,
}

impl Sample {
    /// Returns it as a device takes it.
    pub(super) fn for_device(&self) -> SurfaceSample {
        let angle = match &self.hit {
            Hit::Plane(hit) => view_angle(hit.direction),
            Hit::Sphere(_) => DVec2::ZERO,
        };
        SurfaceSample::new(place(&self.hit), self.moment, angle)
    }
}

impl Node {
    /// Returns the weights of the flow's control points at each time; empty without a flow.
    pub(super) fn flow_weights(&self, times: &[f64]) -> Vec<KnotWeights> {
        let Some(points) = self.flow_points() else {
            return Vec::new();
        };
        let knots = Knots::with_neighbours(points);
        let own_times = times.iter().map(|time| time - self.delay);
        own_times.map(|time| knots.weights(time)).collect()
    }

    /// Returns the appearance of samples. `times` are those of the moments. If `keep` is true, fields store the
    /// activations for [`Node::shade_vjp`].
    pub fn shade(
        &mut self,
        samples: &[Sample],
        times: &[f64],
        detail: &Detail,
        keep: bool,
    ) -> Shading {
        let dimensions = self.dimensions();
        let mut evaluated = [false; 4];
        let mut evaluate = |kind: FieldKind, node: &mut Self, positions: &[f32]| {
            let field = node.fields.slot_mut(kind).as_mut()?;
            if !detail.kinds[kind.number()] {
                return None;
            }
            evaluated[kind.number()] = true;
            let active = detail.active(kind, field);
            Some(if keep {
                field.forward(positions, active)
            } else {
                field.evaluate(positions, active)
            })
        };
        let flow_weights = self.flow_weights(times);
        let mut positions = vec![0.0; samples.len() * dimensions];
        for (sample, out) in samples.iter().zip(positions.chunks_exact_mut(dimensions)) {
            coordinates(place(&sample.hit), dimensions, out);
        }
        let control_points = evaluate(FieldKind::Flow, self, &positions);
        let per_row = self
            .fields
            .flow
            .as_ref()
            .map_or(0, |flow| flow.shape().outputs);
        let queries: Vec<(DVec3, DVec3)> = samples
            .iter()
            .enumerate()
            .map(|(row, sample)| {
                let at = place(&sample.hit);
                let Some(points) = &control_points else {
                    return (at, DVec3::ZERO);
                };
                let points = &points[row * per_row..(row + 1) * per_row];
                let flow = spline_of(points, dimensions, &flow_weights[sample.moment]);
                (moved(at, flow, dimensions), flow)
            })
            .collect();
        for ((query, _), out) in queries.iter().zip(positions.chunks_exact_mut(dimensions)) {
            coordinates(*query, dimensions, out);
        }
        let colours = evaluate(FieldKind::Colour, self, &positions);
        let logits = evaluate(FieldKind::Opacity, self, &positions);
        let mut from_angles = vec![
            0.0;
            if dimensions == 2 {
                4 * samples.len()
            } else {
                0
            }
        ];
        for ((sample, (query, _)), out) in samples
            .iter()
            .zip(&queries)
            .zip(from_angles.as_chunks_mut::<4>().0)
        {
            *out = view_coordinates(*query, &sample.hit);
        }
        let views = evaluate(FieldKind::View, self, &from_angles);
        let view_outputs = self
            .fields
            .view
            .as_ref()
            .map_or(1, |view| view.shape().outputs);
        let node = &*self;
        let shades = queries
            .par_iter()
            .enumerate()
            .map(|(row, &(query, flow))| {
                let added = |values: &Option<Vec<f32>>, width: usize, channel: usize| {
                    let value = values.as_ref().map(|values| values[row * width + channel]);
                    FIELD_WEIGHT * f64::from(value.unwrap_or(0.0))
                };
                let colour = DVec3::from_array(std::array::from_fn(|channel| {
                    added(&colours, 3, channel) + added(&views, view_outputs, channel)
                }));
                let logit = added(&logits, 1, 0)
                    + if view_outputs > 3 {
                        added(&views, view_outputs, 3)
                    } else {
                        0.0
                    };
                node.shade_of(query, flow, colour, logit)
            })
            .collect();
        Shading {
            shades,
            flow_weights,
            evaluated,
        }
    }

    /// Adds the fields' outputs to the base textures.
    fn shade_of(&self, query: DVec3, flow: DVec3, colour: DVec3, logit: f64) -> Shade {
        let base = match self.surface {
            Surface::Plane { .. } => {
                let beyond = if self.opacity.is_some() {
                    TextureEdge::Zero
                } else {
                    TextureEdge::Border
                };
                self.colour.sample(query.truncate(), beyond)
            }
            Surface::Sphere { .. } => self.colour.sample_direction(query),
        };
        let derivative = |by_u: f64, by_v: f64| match self.surface {
            Surface::Plane { .. } => DVec3::new(by_u, by_v, 0.0),
            Surface::Sphere { .. } => direction_gradient(query, by_u, by_v),
        };
        let mut by_query = [DVec3::ZERO; 4];
        for (channel, by_query) in by_query.iter_mut().take(3).enumerate() {
            *by_query = derivative(base.by_u[channel], base.by_v[channel]);
        }
        let mut opacity = 1.0;
        if let Some(texture) = &self.opacity {
            let read = texture.sample(query.truncate(), TextureEdge::Border);
            let [share] = read.value.map(|value| value.clamp(1e-4, 1.0 - 1e-4));
            let by_share = 1.0 / (share * (1.0 - share));
            by_query[3] = by_share * derivative(read.by_u[0], read.by_v[0]);
            let whole = (share / (1.0 - share)).ln() + logit;
            opacity = 1.0 / (1.0 + (-whole).exp());
        }
        let unclamped = DVec3::from_array(base.value) + colour;
        let mut shown = unclamped.clamp(DVec3::ZERO, DVec3::ONE);
        if let Some(overlay) = &self.overlay {
            let painted = match self.surface {
                Surface::Plane { .. } => {
                    overlay.texture.sample(query.truncate(), TextureEdge::Zero)
                }
                Surface::Sphere { .. } => overlay.texture.sample_direction(query),
            };
            let [red, green, blue, cover] = painted.value;
            // Texels are weighted by their opacity already.
            shown = shown * (1.0 - cover) + DVec3::new(red, green, blue);
        }
        Shade {
            colour: shown,
            opacity,
            query,
            unclamped,
            by_query,
            flow,
        }
    }

    /// Returns gradients by the hits from those by appearance, and keeps those by the fields in the fields. Call
    /// it after [`Node::shade`] of the same samples.
    pub fn shade_vjp(
        &mut self,
        samples: &[Sample],
        shaded: &Shading,
        upstream: &[ShadeGradient],
        poses: &[RigidPose],
        rays: &[Ray],
    ) -> Vec<PlaneGradient> {
        let dimensions = self.dimensions();
        let scale = coordinate_scale(dimensions);
        let has_opacity = self.opacity.is_some();
        let rows: Vec<(DVec3, f64)> = shaded
            .shades
            .iter()
            .zip(upstream)
            .map(|(shade, upstream)| {
                let logit = if has_opacity {
                    upstream.opacity * shade.opacity * (1.0 - shade.opacity)
                } else {
                    0.0
                };
                (let_inwards(shade.unclamped, upstream.colour), logit)
            })
            .collect();
        let mut by_query: Vec<DVec3> = shaded
            .shades
            .iter()
            .zip(&rows)
            .map(|(shade, &(colour, logit))| {
                let [red, green, blue, opacity] = shade.by_query;
                colour.x * red + colour.y * green + colour.z * blue + logit * opacity
            })
            .collect();
        let weigh = |value: f64| (FIELD_WEIGHT * value) as f32;
        let mut by_angle = vec![DVec2::ZERO; samples.len()];
        let colours = |rows: &[(DVec3, f64)]| -> Vec<f32> {
            let rows = rows.iter();
            rows.flat_map(|(colour, _)| colour.to_array().map(weigh))
                .collect()
        };
        if shaded.evaluated[FieldKind::Colour.number()]
            && let Some(field) = &mut self.fields.colour
        {
            let by_positions = field.backward(&colours(&rows));
            add_coordinates(&mut by_query, &by_positions, dimensions, scale);
        }
        if shaded.evaluated[FieldKind::Opacity.number()]
            && let Some(field) = &mut self.fields.opacity
        {
            let logits: Vec<f32> = rows.iter().map(|&(_, logit)| weigh(logit)).collect();
            let by_positions = field.backward(&logits);
            add_coordinates(&mut by_query, &by_positions, dimensions, scale);
        }
        if shaded.evaluated[FieldKind::View.number()]
            && let Some(field) = &mut self.fields.view
        {
            let outputs = field.shape().outputs;
            let upstream: Vec<f32> = rows
                .iter()
                .flat_map(|&(colour, logit)| {
                    let [red, green, blue] = colour.to_array();
                    [red, green, blue, logit].into_iter().take(outputs)
                })
                .map(weigh)
                .collect();
            let by_positions = field.backward(&upstream);
            for ((query, angle), by) in by_query
                .iter_mut()
                .zip(&mut by_angle)
                .zip(by_positions.as_chunks::<4>().0)
            {
                let [x, y, u, v] = by.map(f64::from);
                *query += DVec3::new(x, y, 0.0);
                *angle = DVec2::new(u, v) / TAU;
            }
        }
        let by_place = self.flow_vjp(samples, shaded, by_query);
        let node = &*self;
        samples
            .par_iter()
            .zip(by_place)
            .zip(by_angle)
            .map(|((sample, by_place), by_angle)| {
                let ray = &rays[sample.ray];
                node.hit_vjp(sample, ray, &poses[sample.moment], by_place, by_angle)
            })
            .collect()
    }

    /// Returns gradients by the positions of hits from those by queries, through the flow.
    fn flow_vjp(
        &mut self,
        samples: &[Sample],
        shaded: &Shading,
        by_query: Vec<DVec3>,
    ) -> Vec<DVec3> {
        let dimensions = self.dimensions();
        let Some(field) = &mut self.fields.flow else {
            return by_query;
        };
        if !shaded.evaluated[FieldKind::Flow.number()] {
            return by_query;
        }
        let outputs = field.shape().outputs;
        let mut upstream = vec![0.0_f32; samples.len() * outputs];
        let mut by_place = Vec::with_capacity(samples.len());
        let rows = samples.iter().zip(&shaded.shades).zip(&by_query);
        for (((sample, shade), &by_query), upstream) in rows.zip(upstream.chunks_exact_mut(outputs))
        {
            let at = place(&sample.hit);
            let (by_at, by_flow) = moved_vjp(at, shade.flow, dimensions, by_query);
            by_place.push(by_at);
            let weights = &shaded.flow_weights[sample.moment];
            for (&knot, weight) in weights.knots.iter().zip(weights.weights) {
                let point = &mut upstream[knot * dimensions..(knot + 1) * dimensions];
                for (value, by_flow) in point.iter_mut().zip(by_flow.to_array()) {
                    *value += (weight * by_flow) as f32;
                }
            }
        }
        let by_positions = field.backward(&upstream);
        add_coordinates(
            &mut by_place,
            &by_positions,
            dimensions,
            coordinate_scale(dimensions),
        );
        by_place
    }

    /// Returns the gradient by a hit from those by its place and its view angle.
    pub(super) fn hit_vjp(
        &self,
        sample: &Sample,
        ray: &Ray,
        pose: &RigidPose,
        by_place: DVec3,
        by_angle: DVec2,
    ) -> PlaneGradient {
        match (&sample.hit, &self.surface) {
            (Hit::Plane(hit), Surface::Plane { size, .. }) => {
                let by_direction = view_angle_vjp(hit.direction, by_angle);
                plane::hit_vjp(ray, pose, *size, hit, by_place.truncate(), by_direction)
            }
            (Hit::Sphere(hit), Surface::Sphere { radius, .. }) => {
                let sphere = Sphere {
                    centre: pose.centre,
                    radius: *radius,
                };
                PlaneGradient {
                    ray: sphere::hit_vjp(ray, &sphere, hit, by_place),
                    ..PlaneGradient::default()
                }
            }
            // A node's hits are those of its surface.
            _ => PlaneGradient::default(),
        }
    }
}

/// Returns the gradient of a clamped colour: only if it points inwards, so that no texel stays beyond the bounds
/// for good.
pub fn let_inwards(unclamped: DVec3, upstream: DVec3) -> DVec3 {
    let pass = |value: f64, gradient: f64| {
        let is_outwards = (value < 0.0 && gradient > 0.0) || (value > 1.0 && gradient < 0.0);
        if is_outwards { 0.0 } else { gradient }
    };
    DVec3::new(
        pass(unclamped.x, upstream.x),
        pass(unclamped.y, upstream.y),
        pass(unclamped.z, upstream.z),
    )
}
