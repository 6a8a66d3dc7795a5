//! Detection of the projection: is a video equirectangular, and in which layout?
//!
//! Every test of [`TESTS`] measures one thing on frames spread over the video; [`judge`] combines them and keeps all
//! values as evidence. Pixels decide; otherwise metadata does, and a disagreement is recorded. If nothing decides, the
//! projection is `unsure`.
//!
//! To add a test: one file, and one line in [`TESTS`].

pub(crate) mod aspect;
pub(crate) mod black_border;
mod cube_faces;
pub(crate) mod fisheye_circles;
mod pole_rows;
mod samples;
mod stereo_halves;
mod wrap_seam;

pub use samples::FrameSamples;

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{DetectedProjection, Evidence, Probe, SphereTurn, VideoProjection},
    statistics,
};
use omnilife_video::{CUBEMAP, OTHER_CUBEMAP, Rgb8Image};

/// One measurement for the projection.
pub struct ProjectionTest {
    /// Unique id, recorded as evidence.
    pub id: &'static str,
    /// The measured quantity and its reading, in one sentence.
    pub summary: &'static str,
    /// The value that divides the readings.
    pub limit: f64,
    /// Reading of a value up to the limit.
    pub at_most: &'static str,
    /// Reading of a value above the limit.
    pub above: &'static str,
    /// Measures; `None` if the test does not apply to the frames.
    pub measure: fn(&Probe, &[Rgb8Image]) -> Option<f64>,
}

impl ProjectionTest {
    /// Returns the image that it examines: inside of a border, unless it is about borders.
    fn looked_at<'a>(
        &self,
        samples: &'a [Rgb8Image],
        inside: Option<&'a [Rgb8Image]>,
    ) -> &'a [Rgb8Image] {
        inside
            .filter(|_| !LOOK_AT_BORDERS.contains(&self.id))
            .unwrap_or(samples)
    }

    fn evidence(&self, value: f64) -> Evidence {
        let reading = if value <= self.limit {
            self.at_most
        } else {
            self.above
        };
        Evidence {
            test: self.id.to_owned(),
            value,
            limit: self.limit,
            reading: reading.to_owned(),
        }
    }
}

/// All tests; tests walk it.
pub static TESTS: &[ProjectionTest] = &[
    aspect::TEST,
    black_border::SIDES,
    black_border::ROWS,
    fisheye_circles::BLACK_AROUND,
    fisheye_circles::COMMON_RIM,
    wrap_seam::WHOLE,
    wrap_seam::LEFT_HALF,
    pole_rows::TOP,
    pole_rows::BOTTOM,
    stereo_halves::TOP_BOTTOM,
    stereo_halves::LEFT_RIGHT,
    cube_faces::OUTER_EDGES,
    cube_faces::FACE_BREAKS,
];

/// Tests that are quick enough for every sampled frame of shots.
pub(crate) static FRAME_TESTS: &[ProjectionTest] = &[
    black_border::SIDES,
    black_border::ROWS,
    fisheye_circles::BLACK_AROUND,
    wrap_seam::WHOLE,
    pole_rows::TOP,
    pole_rows::BOTTOM,
];

/// Notes rotations that the container states: frames are used as stored.
pub(crate) fn note_turns(video: &Path, probe: &Probe, progress: &dyn Progress) {
    let Some(stated) = &probe.spherical else {
        return;
    };
    let words = |turn: SphereTurn| {
        let SphereTurn {
            yaw_degrees,
            pitch_degrees,
            roll_degrees,
        } = turn;
        format!("yaw {yaw_degrees}, pitch {pitch_degrees}, roll {roll_degrees} degrees")
    };
    let pose = stated.pose.map(|pose| {
        let pose = words(pose);
        format!("players give its sphere the pose that it states ({pose}); frames are not turned, slices state it too")
    });
    let view = stated.initial_view.map(|view| {
        let view = words(view);
        format!("players look where it states first ({view}); frames are not turned, slices do not state it")
    });
    let eye = stated.is_right_eye_first.then(|| {
        "its container states that the right eye's image is the first one, above or on the left: what is taken as the \
         left eye's is the right one's"
            .to_owned()
    });
    let lines = [pose, view, stated.turn_fault.clone(), eye];
    for line in lines.into_iter().flatten() {
        progress.note(&format!("{}: {line}", video.display()));
    }
}

/// Judges a video by its probe and frames spread over it.
///
/// If the frames have a black border, their inside is judged. A whole sphere inside is still no ERP as stored, and the
/// projection is `unsure` with the border as its evidence.
pub fn judge(probe: &Probe, samples: &[Rgb8Image]) -> DetectedProjection {
    let samples = &spread_over(samples);
    let inside = black_border::without_border(samples);
    let mut evidence = Vec::new();
    for test in TESTS {
        if let Some(value) = (test.measure)(probe, test.looked_at(samples, inside.as_deref())) {
            evidence.push(test.evidence(value));
        }
    }
    let pixels = Readings::of(&evidence).decide();
    let mut disagreements = Vec::new();
    let mut projection = pixels;
    match by_metadata(probe) {
        Some((stated, words))
            if pixels == VideoProjection::Unsure && stated != VideoProjection::Unsure =>
        {
            projection = stated;
            disagreements.push(format!(
                "the pixels do not decide; taken from the metadata ({words})"
            ));
        }
        Some((stated, words)) if !agree(stated, pixels) => disagreements.push(format!(
            "the metadata says {words}, the pixels say {}",
            pixels.name()
        )),
        _ => {}
    }
    let conflict = probe
        .spherical
        .as_ref()
        .and_then(|found| found.conflict.as_ref());
    if let Some(conflict) = conflict {
        disagreements.push(format!(
            "the metadata's version 1 says {conflict}, its version 2, which wins, says otherwise"
        ));
    }
    DetectedProjection {
        projection,
        overridden: None,
        evidence,
        disagreement: (!disagreements.is_empty()).then(|| disagreements.join("; ")),
    }
}

/// Measures [`FRAME_TESTS`] on one frame, in their order. A border that ends at sharp edges is cut off.
pub(crate) fn measure_frame(probe: &Probe, image: &Rgb8Image) -> impl Iterator<Item = Option<f64>> {
    let inside = black_border::without_sharp_border(image);
    FRAME_TESTS.iter().map(move |test| {
        let whole = std::slice::from_ref(image);
        let inside = inside.as_ref().map(std::slice::from_ref);
        (test.measure)(probe, test.looked_at(whole, inside))
    })
}

/// Result of the readings of frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Proof {
    /// They are one sphere, equirectangular as a whole.
    Sphere,
    /// They are those of an ordinary camera; `seam` is the wrap seam, above [`FLAT_SEAM`].
    Flat { seam: f64 },
    /// Too little evidence.
    Nothing,
}

/// Judges readings of [`FRAME_TESTS`], in their order.
pub(crate) fn proof(readings: impl Iterator<Item = Option<f64>>) -> Proof {
    let evidence: Vec<Evidence> = FRAME_TESTS
        .iter()
        .zip(readings)
        .filter_map(|(test, value)| Some(test.evidence(value?)))
        .collect();
    let readings = Readings::of(&evidence);
    match (readings.decide(), readings.ratio(&wrap_seam::WHOLE)) {
        (VideoProjection::Rectilinear, Some(ratio)) => Proof::Flat {
            seam: ratio * wrap_seam::WHOLE.limit,
        },
        (projection, _) if projection.is_monoscopic_erp() => Proof::Sphere,
        _ => Proof::Nothing,
    }
}

/// Returns some of the samples, evenly spaced.
fn spread_over(samples: &[Rgb8Image]) -> Vec<Rgb8Image> {
    let step = samples.len().div_ceil(MOST_SAMPLES).max(1);
    samples.iter().step_by(step).cloned().collect()
}

fn agree(stated: VideoProjection, pixels: VideoProjection) -> bool {
    stated == pixels || (stated.is_monoscopic_erp() && pixels.is_monoscopic_erp())
}

/// Returns the projection in the container's spherical metadata, and its words.
pub(crate) fn by_metadata(probe: &Probe) -> Option<(VideoProjection, String)> {
    let metadata = probe.spherical.as_ref()?;
    let stereo = metadata.stereo.as_deref().unwrap_or("2D");
    if metadata.is_cropped {
        let words = format!("a part of the sphere, {}, {stereo}", metadata.projection);
        return Some((VideoProjection::Unsure, words));
    }
    let projection = match (metadata.projection.as_str(), stereo) {
        ("equirectangular", "top and bottom") => VideoProjection::ErpStereoTb,
        ("equirectangular", "side by side") => VideoProjection::ErpStereoLr,
        ("equirectangular", _) if aspect::is_two_to_one(probe) => VideoProjection::Erp,
        ("equirectangular", _) => VideoProjection::ErpSqueezed,
        (CUBEMAP | OTHER_CUBEMAP | "equiangular cubemap", _) => VideoProjection::Eac,
        ("fisheye", _) => VideoProjection::Fisheye,
        ("rectilinear", _) => VideoProjection::Rectilinear,
        // A mesh is an arbitrary map from image to sphere; nothing here reads it.
        ("mesh", _) => VideoProjection::Unsure,
        _ => return None,
    };
    Some((projection, format!("{}, {stereo}", metadata.projection)))
}

/// The evidence by test, for the rules of [`Readings::decide`].
struct Readings<'a>(&'a [Evidence]);

impl<'a> Readings<'a> {
    fn of(evidence: &'a [Evidence]) -> Self {
        Self(evidence)
    }

    /// Returns value over limit, or `None` if the test did not apply.
    fn ratio(&self, test: &ProjectionTest) -> Option<f64> {
        self.0
            .iter()
            .find(|evidence| evidence.test == test.id)
            .map(|evidence| evidence.value / evidence.limit)
    }

    fn holds(&self, test: &ProjectionTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio <= 1.0)
    }

    fn exceeds(&self, test: &ProjectionTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio > 1.0)
    }

    /// Returns true if the limit is missed by so much that the opposite is certain.
    fn far_exceeds(&self, test: &ProjectionTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio > CLEARLY)
    }

    fn decide(&self) -> VideoProjection {
        if self.exceeds(&fisheye_circles::BLACK_AROUND) {
            return VideoProjection::Fisheye;
        }
        let projection = self.projection();
        let has_border = self.exceeds(&black_border::SIDES) || self.exceeds(&black_border::ROWS);
        if has_border && projection != VideoProjection::Rectilinear {
            return VideoProjection::Unsure;
        }
        projection
    }

    /// Returns the projection of the image without its border.
    fn projection(&self) -> VideoProjection {
        let wraps = self.holds(&wrap_seam::WHOLE);
        let has_caps = self.holds(&pole_rows::TOP) && self.holds(&pole_rows::BOTTOM);
        // Halves that show the same scene leave little doubt, so poles may be blurred.
        let may_have_caps =
            !self.far_exceeds(&pole_rows::TOP) && !self.far_exceeds(&pole_rows::BOTTOM);
        if self.exceeds(&stereo_halves::LEFT_RIGHT)
            && self.holds(&wrap_seam::LEFT_HALF)
            && may_have_caps
        {
            return VideoProjection::ErpStereoLr;
        }
        if self.exceeds(&stereo_halves::TOP_BOTTOM) && wraps && may_have_caps {
            return VideoProjection::ErpStereoTb;
        }
        if wraps && has_caps {
            return if self.holds(&aspect::TEST) {
                VideoProjection::Erp
            } else {
                VideoProjection::ErpSqueezed
            };
        }
        let has_no_caps = self.exceeds(&pole_rows::TOP) || self.exceeds(&pole_rows::BOTTOM);
        if wraps || !has_no_caps {
            // A panorama that is cropped in one direction, or too plain to decide.
            return VideoProjection::Unsure;
        }
        if self.holds(&cube_faces::OUTER_EDGES) && self.exceeds(&cube_faces::FACE_BREAKS) {
            return VideoProjection::Eac;
        }
        if self.exceeds(&fisheye_circles::COMMON_RIM) {
            return VideoProjection::Fisheye;
        }
        if self.far_exceeds(&wrap_seam::WHOLE) {
            return VideoProjection::Rectilinear;
        }
        VideoProjection::Unsure
    }
}

/// Tests that examine the whole image while the others examine the inside of its border.
const LOOK_AT_BORDERS: &[&str] = &[
    aspect::TEST.id,
    black_border::SIDES.id,
    black_border::ROWS.id,
    fisheye_circles::BLACK_AROUND.id,
];

/// Maximum number of examined frames: more do not improve a median.
const MOST_SAMPLES: usize = 8;
/// Factor over its limit from which on a value proves the opposite.
const CLEARLY: f64 = 1.5;
/// The wrap seam above which an image without poles is flat.
pub(crate) const FLAT_SEAM: f64 = CLEARLY * wrap_seam::WHOLE.limit;

/// Returns the median over the samples of a measurement that may not apply.
fn median_over(samples: &[Rgb8Image], measure: impl Fn(&Rgb8Image) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = samples.iter().filter_map(measure).collect();
    statistics::median(&values)
}
