//! Records of OpenMVG's `sfm_data` as cereal writes them, as far as they are read.
//!
//! A type is named with its first object (`polymorphic_name`, and the highest bit of `polymorphic_id`); later
//! objects have the number alone. Views of versions 0.1 and 0.2 have neither. A spherical intrinsic has its size
//! inside of its base class (`value0`), a pinhole beside its own values.

use std::collections::BTreeMap;

use omnilife_schemas::camera::{Camera, ErpCamera, PinholeCamera};
use serde::Deserialize;
use serde_json::Value;

use crate::poses::{
    frame_camera::FrameCamera,
    lens::{Distortion, Lens, Projection},
};

use super::{Extrinsic, FIRST_OF_ITS_KIND, KeyedEntry, PINHOLE, SPHERICAL, View};

#[derive(Deserialize)]
pub(super) struct SfmData {
    #[serde(default)]
    pub(super) views: Vec<KeyedEntry<Polymorphic<View>>>,
    #[serde(default)]
    pub(super) intrinsics: Vec<KeyedEntry<Polymorphic<Intrinsic>>>,
    #[serde(default)]
    pub(super) extrinsics: Vec<KeyedEntry<Extrinsic>>,
    /// Landmarks with their observations, which have no colours.
    #[serde(default)]
    pub(super) structure: Vec<serde::de::IgnoredAny>,
}

#[derive(Deserialize)]
pub(super) struct Polymorphic<T> {
    #[serde(default)]
    polymorphic_id: u32,
    #[serde(default)]
    polymorphic_name: Option<String>,
    ptr_wrapper: Pointer<T>,
}

#[derive(Deserialize)]
struct Pointer<T> {
    data: T,
}

impl<T> Polymorphic<T> {
    pub(super) fn data(&self) -> &T {
        &self.ptr_wrapper.data
    }
}

/// Width and height, pixels.
#[derive(Deserialize)]
struct Size {
    width: u32,
    height: u32,
}

#[derive(Deserialize)]
pub(super) struct Intrinsic {
    #[serde(default)]
    value0: Option<Size>,
    #[serde(default)]
    width: u32,
    #[serde(default)]
    height: u32,
    /// Focal length of a pinhole, pixels.
    #[serde(default)]
    focal_length: Option<f64>,
    #[serde(default)]
    principal_point: Option<[f64; 2]>,
    /// Further entries, a lens among them.
    #[serde(flatten)]
    others: BTreeMap<String, Value>,
}

struct LensType {
    /// Name of the type, and the entry that has its terms.
    name: &'static str,
    entry: &'static str,
    terms: usize,
    distortion: fn(&[f64]) -> Distortion,
}

/// All types with a lens (OpenMVG, `src/openMVG/cameras/Camera_Pinhole_*.hpp`).
const LENSES: [LensType; 4] = [
    LensType {
        name: "pinhole_radial_k1",
        entry: "disto_k1",
        terms: 1,
        distortion: radial,
    },
    LensType {
        name: "pinhole_radial_k3",
        entry: "disto_k3",
        terms: 3,
        distortion: radial,
    },
    LensType {
        name: "pinhole_brown_t2",
        entry: "disto_t2",
        terms: 5,
        distortion: brown,
    },
    LensType {
        name: "fisheye",
        entry: "fisheye",
        terms: 4,
        distortion: fisheye,
    },
];

fn radial(terms: &[f64]) -> Distortion {
    let mut distortion = Distortion::default();
    for (own, term) in distortion.radial.iter_mut().zip(terms) {
        *own = *term;
    }
    distortion
}

fn brown(terms: &[f64]) -> Distortion {
    let (k, t) = terms.split_at(terms.len().min(3));
    let mut distortion = radial(k);
    for (own, term) in distortion.tangential.iter_mut().zip(t) {
        *own = *term;
    }
    distortion
}

fn fisheye(terms: &[f64]) -> Distortion {
    Distortion {
        projection: Projection::Equidistant,
        ..radial(terms)
    }
}

/// Returns the cameras of intrinsics by their key, or the reason why one cannot be read if a view uses it.
pub(super) fn cameras(data: &SfmData) -> BTreeMap<u32, Result<FrameCamera, String>> {
    let views = data.views.iter().map(|view| &view.value);
    let mut names: BTreeMap<u32, &str> = views
        .filter_map(|view| Some((view.polymorphic_id, view.polymorphic_name.as_deref()?)))
        .map(|(id, name)| (id & !FIRST_OF_ITS_KIND, name))
        .collect();
    let mut cameras = BTreeMap::new();
    for KeyedEntry { key, value } in &data.intrinsics {
        let id = value.polymorphic_id & !FIRST_OF_ITS_KIND;
        if let Some(name) = &value.polymorphic_name {
            names.insert(id, name);
        }
        let camera = match names.get(&id) {
            Some(name) => value.data().camera(name),
            None => Err(format!("its type {id} has no name")),
        };
        cameras.insert(
            *key,
            camera.map_err(|reason| format!("intrinsic {key}: {reason}")),
        );
    }
    cameras
}

impl Intrinsic {
    /// # Errors
    /// For unknown kinds, and missing or unknown entries.
    fn camera(&self, name: &str) -> Result<FrameCamera, String> {
        let (width, height) = match &self.value0 {
            Some(size) => (size.width, size.height),
            None => (self.width, self.height),
        };
        let lens = LENSES.iter().find(|lens| lens.name == name);
        if ![SPHERICAL, PINHOLE].contains(&name) && lens.is_none() {
            let lenses = LENSES.map(|lens| lens.name).join(", ");
            return Err(format!(
                "is {name}; known are {SPHERICAL}, {PINHOLE}, {lenses}"
            ));
        }
        let is_known = |entry: &str| lens.is_some_and(|lens| lens.entry == entry);
        if let Some(entry) = self.others.keys().find(|entry| !is_known(entry)) {
            return Err(format!("{entry} of its {name} camera is not known"));
        }
        if width == 0 || height == 0 {
            return Err(format!("its {name} camera has no size"));
        }
        match (name, self.focal_length, self.principal_point) {
            // Camera_Spherical has a turn for the larger side, and as many pixels for a degree in height.
            (SPHERICAL, ..) if u64::from(width) != u64::from(height).saturating_mul(2) => {
                Err(format!(
                    "its sphere of {width}x{height} is not twice as wide as high: in OpenMVG it shows less or more \
                 than half a turn in height"
                ))
            }
            (SPHERICAL, ..) => {
                let camera: Camera = ErpCamera { width, height }.into();
                Ok(camera.into())
            }
            (_, Some(focal), Some([cx, cy])) if focal > 0.0 => FrameCamera::behind(Lens {
                camera: PinholeCamera {
                    width,
                    height,
                    fx: focal,
                    fy: focal,
                    cx,
                    cy,
                },
                distortion: self.distortion(name)?,
            }),
            _ => Err("its pinhole lacks a focal length or a principal point".to_owned()),
        }
    }

    /// Returns the lens of a type.
    ///
    /// # Errors
    /// When its terms are missing, or are not as many finite numbers as the type has.
    fn distortion(&self, name: &str) -> Result<Distortion, String> {
        let Some(lens) = LENSES.iter().find(|lens| lens.name == name) else {
            return Ok(Distortion::default());
        };
        let terms: Option<Vec<f64>> = self
            .others
            .get(lens.entry)
            .and_then(Value::as_array)
            .and_then(|terms| terms.iter().map(Value::as_f64).collect());
        match terms {
            Some(terms) if terms.len() == lens.terms => Ok((lens.distortion)(&terms)),
            _ => Err(format!(
                "{} of its {name} camera must be {} numbers",
                lens.entry, lens.terms
            )),
        }
    }
}
