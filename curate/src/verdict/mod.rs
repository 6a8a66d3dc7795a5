//! Is this video equirectangular, and in which layout?
//!
//! Every test of [`TESTS`] measures one thing on frames spread over the video; [`judge`] combines
//! them and keeps all values as evidence. Pixels decide; metadata is consulted where they do not,
//! and a disagreement is recorded. Where nothing decides, the verdict is `unsure`.
//!
//! To add a test: one file, and one line in [`TESTS`].

pub(crate) mod aspect;
mod black_border;
mod pole_rows;
mod samples;
mod stereo_halves;
mod wrap_seam;

pub use samples::FrameSamples;

use omnilife_schemas::records::{ErpVerdict, Evidence, Probe, Verdict};

use crate::{statistics, video::Rgb8Picture};

/// One measurement for the verdict.
pub struct VerdictTest {
    /// Unique id, recorded as evidence.
    pub id: &'static str,
    /// What is measured and how it is to be read, in one sentence.
    pub summary: &'static str,
    /// The value that divides the readings.
    pub limit: f64,
    /// What a value at most the limit says.
    pub at_most: &'static str,
    /// What a value above the limit says.
    pub above: &'static str,
    /// Measures; `None` where the test has nothing to look at.
    pub measure: fn(&Probe, &[Rgb8Picture]) -> Option<f64>,
}

/// All tests; tests walk it.
pub static TESTS: &[VerdictTest] = &[
    aspect::TEST,
    black_border::SIDES,
    black_border::CORNERS,
    wrap_seam::WHOLE,
    wrap_seam::LEFT_HALF,
    pole_rows::TOP,
    pole_rows::BOTTOM,
    pole_rows::MIDDLE,
    stereo_halves::TOP_BOTTOM,
    stereo_halves::LEFT_RIGHT,
];

/// Judges a video by its probe and frames spread over it.
pub fn judge(probe: &Probe, samples: &[Rgb8Picture]) -> ErpVerdict {
    let mut evidence = Vec::new();
    for test in TESTS {
        if let Some(value) = (test.measure)(probe, samples) {
            evidence.push(Evidence {
                test: test.id.to_owned(),
                value,
                limit: test.limit,
                reading: if value <= test.limit {
                    test.at_most
                } else {
                    test.above
                }
                .to_owned(),
            });
        }
    }
    let pixels = Readings::of(&evidence).decide();
    let metadata = by_metadata(probe);
    let (verdict, disagreement) = match metadata {
        Some((stated, words)) if pixels == Verdict::Unsure => (
            stated,
            Some(format!(
                "the pixels do not decide; taken from the metadata ({words})"
            )),
        ),
        Some((stated, words)) if !agree(stated, pixels) => (
            pixels,
            Some(format!(
                "the metadata says {words}, the pixels say {}",
                pixels.name()
            )),
        ),
        _ => (pixels, None),
    };
    ErpVerdict {
        verdict,
        overridden: None,
        evidence,
        disagreement,
    }
}

fn agree(stated: Verdict, pixels: Verdict) -> bool {
    stated == pixels || (stated.is_monoscopic_erp() && pixels.is_monoscopic_erp())
}

/// What the container's spherical metadata claims, and its words.
fn by_metadata(probe: &Probe) -> Option<(Verdict, String)> {
    let metadata = probe.spherical.as_ref()?;
    let stereo = metadata.stereo.as_deref().unwrap_or("2D");
    let verdict = match (metadata.projection.as_str(), stereo) {
        ("equirectangular", "top and bottom") => Verdict::ErpStereoTb,
        ("equirectangular", "side by side") => Verdict::ErpStereoLr,
        ("equirectangular", _) if aspect::is_two_to_one(probe) => Verdict::Erp,
        ("equirectangular", _) => Verdict::ErpSqueezed,
        ("cubemap", _) => Verdict::Eac,
        _ => return None,
    };
    Some((verdict, format!("{}, {stereo}", metadata.projection)))
}

/// The evidence by test, for the rules of [`Readings::decide`].
struct Readings<'a>(&'a [Evidence]);

impl<'a> Readings<'a> {
    fn of(evidence: &'a [Evidence]) -> Self {
        Self(evidence)
    }

    /// Value over limit, or `None` where the test had nothing to look at.
    fn ratio(&self, test: &VerdictTest) -> Option<f64> {
        self.0
            .iter()
            .find(|evidence| evidence.test == test.id)
            .map(|evidence| evidence.value / evidence.limit)
    }

    fn holds(&self, test: &VerdictTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio <= 1.0)
    }

    fn exceeds(&self, test: &VerdictTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio > 1.0)
    }

    /// Whether the limit is missed by so much that the opposite is sure.
    fn far_exceeds(&self, test: &VerdictTest) -> bool {
        self.ratio(test).is_some_and(|ratio| ratio > CLEARLY)
    }

    fn decide(&self) -> Verdict {
        let wraps = self.holds(&wrap_seam::WHOLE);
        let has_caps = self.holds(&pole_rows::TOP) && self.holds(&pole_rows::BOTTOM);
        if self.exceeds(&black_border::SIDES) {
            // A pillarbox, or half a sphere: its left and right edge agree in being black.
            return Verdict::Unsure;
        }
        if self.exceeds(&stereo_halves::LEFT_RIGHT) && self.holds(&wrap_seam::LEFT_HALF) && has_caps
        {
            return Verdict::ErpStereoLr;
        }
        if self.exceeds(&stereo_halves::TOP_BOTTOM)
            && wraps
            && has_caps
            && self.holds(&pole_rows::MIDDLE)
        {
            return Verdict::ErpStereoTb;
        }
        if wraps && has_caps {
            return if self.holds(&aspect::TEST) {
                Verdict::Erp
            } else {
                Verdict::ErpSqueezed
            };
        }
        let has_no_caps = self.exceeds(&pole_rows::TOP) || self.exceeds(&pole_rows::BOTTOM);
        if self.far_exceeds(&wrap_seam::WHOLE) && has_no_caps && self.holds(&black_border::CORNERS)
        {
            return Verdict::Rectilinear;
        }
        Verdict::Unsure
    }
}

/// How many times its limit a value must reach to prove the opposite.
const CLEARLY: f64 = 1.5;

/// Median over the samples of a measurement that may have nothing to look at.
fn median_over(
    samples: &[Rgb8Picture],
    measure: impl Fn(&Rgb8Picture) -> Option<f64>,
) -> Option<f64> {
    let values: Vec<f64> = samples.iter().filter_map(measure).collect();
    statistics::median(&values)
}
