//! Outputs of a run of the method: layers of views, and images of its atlas.

use std::path::Path;

use glam::{DVec2, DVec3};
use omnilife_engine::camera::View;
use omnilife_schemas::{
    RgbImage, Similarity,
    store::{self, StoreError},
};
use rayon::prelude::*;
use serde::Serialize;

use super::{
    graph::{Graph, Visibility},
    node::{Hit, Node, Surface},
    saved,
    shade::{Detail, Sample},
};
use omnilife_engine::surfaces::{plane::PlaneHit, sphere::SphereHit};
use omnilife_training::{
    error::ReconstructError,
    models::{Export, ModelFormat, OpenRequest, OpenedModel, PlannedFiles},
};

/// Model format of textured planes and spheres that move along trajectories.
pub const ATLAS: ModelFormat = ModelFormat {
    files: &[saved::ATLAS_FILE, saved::ATLAS_VALUES_FILE],
    open: |request| Ok(Box::new(OpenedAtlas::open(request)?)),
    edit: Some(super::edit::edit),
    exports: &[Export::Textures(textures)],
};

/// Layers of an atlas, by name.
const LAYERS: &str = "all, background, object:ID, matte:ID or without:ID";

/// An atlas with its visible part.
struct OpenedAtlas {
    graph: Graph,
    shown: Visibility,
    /// Object that alone is visible.
    object: Option<String>,
    normalization: Similarity,
}

impl OpenedAtlas {
    fn open(request: &OpenRequest<'_>) -> Result<Self, ReconstructError> {
        let graph = saved::read(request.path)?;
        let normalization = request.run.map(|run| run.normalization);
        let object = request.layer.strip_prefix("object:");
        Ok(Self {
            object: object.map(str::to_owned),
            shown: shown(&graph, request.path, request.layer)?,
            graph,
            normalization: normalization.unwrap_or(request.of_cameras),
        })
    }
}

impl OpenedModel for OpenedAtlas {
    fn normalization(&self) -> Similarity {
        self.normalization
    }

    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        Ok(self.graph.image(view, &self.shown).0)
    }

    fn object_centres(&self, id: &str, seconds: &[f64]) -> Result<Vec<DVec3>, ReconstructError> {
        let number =
            find(&self.graph, id).map_err(|reason| ReconstructError::Request { reason })?;
        let (node, clock) = (&self.graph.nodes[number], &self.graph.clock);
        // Trajectories are known from 0 to 1.
        let centre = |&time: &f64| node.pose(clock.time(time).clamp(0.0, 1.0)).centre;
        let centres = seconds.iter().map(centre);
        Ok(centres
            .map(|place| self.normalization.restore(place))
            .collect())
    }

    fn has_opacity(&self) -> bool {
        self.object.is_some()
    }

    fn opacity(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        let shown = match &self.object {
            Some(object) => Visibility::Opacity(object.clone()),
            None => Visibility::All,
        };
        Ok(self.graph.image(view, &shown).0)
    }
}

/// Returns the layer of this name.
fn shown(graph: &Graph, folder: &Path, layer: &str) -> Result<Visibility, ReconstructError> {
    let id = |id: &str| match find(graph, id) {
        Ok(_) => Ok(id.to_owned()),
        Err(reason) => Err(ReconstructError::Request {
            reason: format!("{}: {reason}", folder.display()),
        }),
    };
    match layer.split_once(':') {
        None if layer == "all" => Ok(Visibility::All),
        None if layer == "background" => Ok(Visibility::Only(id(layer)?)),
        Some(("object", name)) => Ok(Visibility::Only(id(name)?)),
        Some(("matte", name)) => Ok(Visibility::Matte(id(name)?)),
        Some(("without", name)) => Ok(Visibility::Without(id(name)?)),
        _ => Err(ReconstructError::Request {
            reason: format!("the layer of an atlas must be {LAYERS}, got {layer:?}"),
        }),
    }
}

/// Returns the number of a node.
///
/// # Errors
/// When no node has this name; the error lists all names.
pub(super) fn find(graph: &Graph, id: &str) -> Result<usize, String> {
    graph.find(id).ok_or_else(|| {
        let all: Vec<&str> = graph.nodes.iter().map(|node| node.id.as_str()).collect();
        format!("the object must be one of {}, got {id:?}", all.join(", "))
    })
}

/// An entry in the list of an atlas's images.
#[derive(Debug, Serialize)]
struct AtlasEntry {
    id: String,
    file: String,
    width: usize,
    height: usize,
    surface: &'static str,
}

/// Name of the list of an atlas's images.
const LIST_FILE: &str = "nodes.json";

/// Plans an RGBA image of each node of a run's atlas, and a list of them. Each has base colour and the colour
/// field, base opacity and the opacity field, without flow and view.
fn textures(run: &Path) -> Result<PlannedFiles<'static>, ReconstructError> {
    let graph = saved::read(run)?;
    let images = graph.nodes.iter().map(image_file);
    Ok(PlannedFiles {
        files: images.chain([LIST_FILE.to_owned()]).collect(),
        write: Box::new(|out| write_textures(graph, out)),
    })
}

fn image_file(node: &Node) -> String {
    format!("{}.png", node.id)
}

fn write_textures(mut graph: Graph, out: &Path) -> Result<(), ReconstructError> {
    let mut entries = Vec::new();
    for node in &mut graph.nodes {
        let (width, height) = (node.colour.width, node.colour.height);
        let rgba = node_image(node, width, height);
        let file = image_file(node);
        let path = out.join(&file);
        store::write_with(&path, |writer| {
            let encoder = image::codecs::png::PngEncoder::new(writer);
            image::ImageEncoder::write_image(
                encoder,
                &rgba,
                width as u32,
                height as u32,
                image::ExtendedColorType::Rgba8,
            )
            .map_err(std::io::Error::other)
        })?;
        entries.push(AtlasEntry {
            id: node.id.clone(),
            file,
            width,
            height,
            surface: match node.surface {
                Surface::Plane { .. } => "plane",
                Surface::Sphere { .. } => "sphere",
            },
        });
    }
    let list = out.join(LIST_FILE);
    let text = serde_json::to_vec_pretty(&entries)
        .map_err(|error| StoreError::write(&list, std::io::Error::other(error)))?;
    Ok(store::write_bytes(&list, &text)?)
}

/// Returns the RGBA of a node's surface, texel by texel.
fn node_image(node: &mut Node, width: usize, height: usize) -> Vec<u8> {
    let hits: Vec<Sample> = (0..width * height)
        .map(|texel| Sample {
            ray: texel,
            moment: 0,
            hit: hit_at(node, texel, width, height),
        })
        .collect();
    // Colour and opacity alone: no flow, no view.
    let detail = Detail {
        kinds: [true, true, false, false],
        active_share: 1.0,
    };
    let shaded = node.shade(&hits, &[0.0], &detail, false);
    shaded
        .shades
        .par_iter()
        .flat_map_iter(|shade| {
            let [red, green, blue] = shade.colour.to_array();
            [red, green, blue, shade.opacity].map(|value| (255.0 * value).round() as u8)
        })
        .collect()
}

/// Returns the hit of a ray straight onto a texel.
fn hit_at(node: &Node, texel: usize, width: usize, height: usize) -> Hit {
    let (column, row) = (texel % width, texel / width);
    match node.surface {
        Surface::Plane { .. } => {
            let share = |at: usize, count: usize| at as f64 / (count.max(2) - 1) as f64;
            Hit::Plane(PlaneHit {
                distance: 1.0,
                uv: DVec2::new(share(column, width), share(row, height)),
                direction: DVec3::Z,
            })
        }
        Surface::Sphere { .. } => {
            use std::f64::consts::{PI, TAU};
            let longitude = ((column as f64 + 0.5) / width as f64 - 0.5) * TAU;
            let latitude = (0.5 - (row as f64 + 0.5) / height as f64) * PI;
            let (sin, cos) = longitude.sin_cos();
            Hit::Sphere(SphereHit {
                distance: 1.0,
                normal: DVec3::new(latitude.cos() * sin, -latitude.sin(), latitude.cos() * cos),
            })
        }
    }
}
