//! Operator, tripod, mount: content that stays in the camera's frame while the scene goes by.
//!
//! It does not belong to the scene, and its mask makes pixels ignored. The result is written as
//! `operator/operator.json`, with the mask of all frames and an image to look at. On request, caps around the poles are
//! looked for too (`caps`). Where the evidence is weak, a person has to decide by the image.

mod attached;
mod caps;
mod evidence;
mod people;
mod region;
mod view;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    RgbImage,
    layout::{OPERATOR_FILE, OPERATOR_FOLDER, SEQUENCE_FILE},
    progress::Progress,
    records::{CapKind, Operator, OperatorCap, OperatorFinding, Pole, Sequence},
    rgb::Mask,
    stage::StagePlan,
    staging::Staging,
    store,
};

use self::{caps::Cap, evidence::GoesBy, region::Region};
use super::{deeplab, dynamic_share, reliability, reliability::Target, residual};
use crate::{edited_frames::with_edited_frames, error::CurateError, motion::GreySphere};

/// Id of the detector in [`reliability`].
pub const ID: &str = "operator";
/// Files beside the record.
const MASK_FILE: &str = "mask.png";
const IMAGE_FILE: &str = "image.png";

/// Least time between the frames of a pair, seconds.
const GAP_SECONDS: f64 = 1.0;
/// Number of pairs, spread over the sequence.
const MOST_PAIRS: usize = 24;
/// Minimum number of pairs for a finding.
const LEAST_PAIRS: usize = 4;
/// Evidence from which a region is entered, and from which a person is asked: grey levels of 255 times steradians. An
/// operator with a helmet has 2.1 in a model of this search (`scripts/calibrate/operators.py`); of scenes without an
/// operator the strongest region has 0.5.
const FOUND: f64 = 1.5;
const DOUBTFUL: f64 = 0.75;
/// Least share of the sphere that people have who carry the camera.
const LEAST_PEOPLE: f64 = 1e-3;

/// Words on caps in records.
const CAPS_UNMEASURED: &str = "; caps around the poles by limits that are not measured on labels";

/// Words on people in records of searches that left them out.
const NO_PEOPLE: &str = "; people were not looked for (curate operator --people)";

/// Parts of the search that are made on request.
#[derive(Debug, Clone, Copy, Default)]
pub struct OperatorSearch {
    /// Also asks the network of [`deeplab`] for people who keep their place.
    pub people: bool,
    /// Also looks for caps around the poles that stay: a tripod below a camera that turns, a gap between lenses.
    pub caps: bool,
}

fn settings(search: OperatorSearch) -> String {
    let people = match search.people {
        true => format!(
            "; people by {}, {}",
            (deeplab::METHOD.settings)(),
            people::settings()
        ),
        false => String::new(),
    };
    let caps = caps_words(search);
    format!(
        "{} px, shades from {} px left out, up to {MOST_PAIRS} pairs of frames {GAP_SECONDS} s apart, found from {FOUND}, doubtful from {DOUBTFUL}{people}{caps}",
        evidence::WIDTH,
        evidence::SHADES_PIXELS,
    )
}

fn caps_words(search: OperatorSearch) -> &'static str {
    match search.caps {
        true => CAPS_UNMEASURED,
        false => "",
    }
}

/// Looks for content that stays in the camera's frame and writes it into the folder of a sequence; skipped, with a note,
/// if its frames are unchanged.
///
/// # Errors
/// When the sequence, a frame or the network cannot be read, or a file cannot be written.
pub fn write_operator(
    folder: &Path,
    search: OperatorSearch,
    progress: &dyn Progress,
) -> Result<Operator, CurateError> {
    let path = folder.join(SEQUENCE_FILE);
    let sequence: Sequence = store::read_record(&path)?;
    let plan = StagePlan::new(folder, ID)
        .with_file(&path)?
        .with_text("settings", &settings(search));
    let plan = with_edited_frames(plan, (folder, &sequence), progress)?;
    let record = format!("{OPERATOR_FOLDER}/{OPERATOR_FILE}");
    let skipped = format!("{}: operator unchanged, skipped", sequence.id);
    plan.make((&record, &skipped), [&record], progress, |made| {
        let result = judge(folder, &sequence, search, progress)?;
        let files = match &result.region {
            Some(region) => Some(draw(folder, &sequence, region)?),
            None => None,
        };
        let mut staging = Staging::new(folder, OPERATOR_FOLDER)?;
        let share = files.as_ref().map_or(0.0, |(mask, _)| dynamic_share(mask));
        if let Some((mask, image)) = &files {
            mask.write_png(&staging.begin(&format!("{OPERATOR_FOLDER}/{MASK_FILE}"))?)?;
            image.write_png(&staging.begin(&format!("{OPERATOR_FOLDER}/{IMAGE_FILE}"))?)?;
        }
        made.replace(&staging.folder, &staging.files)?;
        store::create_folder(&folder.join(OPERATOR_FOLDER))?;
        let named = |file: &str| files.as_ref().map(|_| file.to_owned());
        Ok::<_, CurateError>(Operator {
            sequence: sequence.id.clone(),
            finding: result.finding,
            reason: result.reason,
            evidence: result.evidence,
            share,
            pairs: result.pairs as u32,
            settings: settings(search),
            reliability: reliability::of(ID, Target::Operator).text + caps_words(search),
            mask: named(MASK_FILE),
            image: named(IMAGE_FILE),
            caps: result.caps,
        })
    })
}

/// Returns the file of a sequence's mask of its operator, where one was found.
///
/// # Errors
/// When the record cannot be read.
pub fn found_mask(folder: &Path) -> Result<Option<PathBuf>, CurateError> {
    let folder = folder.join(OPERATOR_FOLDER);
    let record = folder.join(OPERATOR_FILE);
    if !record.is_file() {
        return Ok(None);
    }
    let record: Operator = store::read_record(&record)?;
    let is_found = record.finding == OperatorFinding::Found;
    Ok(record
        .mask
        .filter(|_| is_found)
        .map(|file| folder.join(file)))
}

/// Result of the search in a sequence, with the region found.
struct SearchResult {
    finding: OperatorFinding,
    reason: String,
    evidence: f64,
    region: Option<Region>,
    pairs: usize,
    caps: Vec<OperatorCap>,
}

impl SearchResult {
    fn unjudged(reason: String, pairs: usize) -> Self {
        Self {
            finding: OperatorFinding::Unjudged,
            reason,
            evidence: 0.0,
            region: None,
            pairs,
            caps: Vec::new(),
        }
    }

    /// Judges by the strongest region, and by people who stay.
    fn of(region: Option<Region>, people: Option<Mask>, pairs: usize) -> Self {
        let strength = region.as_ref().map_or(0.0, |region| region.evidence);
        let people = people.filter(|mask| dynamic_share(mask) >= LEAST_PEOPLE);
        let outline = match strength {
            strength if strength >= FOUND => OperatorFinding::Found,
            strength if strength >= DOUBTFUL => OperatorFinding::Doubtful,
            _ => OperatorFinding::Nothing,
        };
        let (finding, what, mask) = match (outline, region, people) {
            (OperatorFinding::Found, Some(region), Some(people)) => {
                let both = region.mask.united(&people);
                (outline, "a region and people stay", Some(both))
            }
            (OperatorFinding::Found, Some(region), None) => {
                (outline, "a region stays", Some(region.mask))
            }
            (_, _, Some(people)) => (OperatorFinding::Found, "people stay", Some(people)),
            (OperatorFinding::Doubtful, Some(region), None) => {
                (outline, "a region may stay", Some(region.mask))
            }
            (_, _, None) => (OperatorFinding::Nothing, "no region stays", None),
        };
        Self {
            finding,
            reason: format!(
                "{what} in the camera's frame while the scene goes by; the strongest outline has evidence {strength:.2}"
            ),
            evidence: strength,
            region: mask.map(|mask| Region {
                mask,
                evidence: strength,
            }),
            pairs,
            caps: Vec::new(),
        }
    }

    /// Judges where the scene goes by below the horizon alone, by people: a rock in a river keeps its place too.
    fn below(people: Option<Mask>, pairs: usize) -> Self {
        let mut judged = Self::of(None, people, pairs);
        if judged.finding == OperatorFinding::Found {
            judged.reason = "people stay in the camera's frame while the scene goes by below the horizon; outlines \
                             are not judged there"
                .to_owned();
            return judged;
        }
        let reason = "the scene goes by below the horizon alone, where only people are judged";
        Self::unjudged(reason.to_owned(), pairs)
    }

    /// Adds caps: those that are found to the mask, and doubtful ones as a question if nothing else was found. The
    /// reason begins with the caps that settle the finding.
    fn with_caps(mut self, caps: Vec<Cap>) -> Self {
        let has = |finding: OperatorFinding| caps.iter().any(|cap| cap.record.finding == finding);
        let is_open =
            self.finding == OperatorFinding::Nothing || self.finding == OperatorFinding::Unjudged;
        let entered = match (has(OperatorFinding::Found), is_open && !caps.is_empty()) {
            (true, _) => Some(OperatorFinding::Found),
            (false, true) => Some(OperatorFinding::Doubtful),
            (false, false) => None,
        };
        if let Some(finding) = entered {
            let is_found = self.finding == OperatorFinding::Found;
            let region = self.region.take().filter(|_| is_found);
            let of_caps = caps.iter().filter(|cap| cap.record.finding == finding);
            let masks = of_caps.map(|cap| cap.mask.clone());
            let all = region.map(|region| region.mask).into_iter().chain(masks);
            let evidence = self.evidence;
            self.region = all
                .reduce(|all, mask| all.united(&mask))
                .map(|mask| Region { mask, evidence });
            self.finding = finding;
        }
        let (settling, others): (Vec<&Cap>, Vec<&Cap>) =
            (caps.iter()).partition(|cap| Some(cap.record.finding) == entered);
        let [mut words, others] = [settling, others].map(|caps| {
            let words = caps.into_iter().map(|cap| described(&cap.record));
            words.collect::<Vec<String>>()
        });
        words.push(self.reason);
        words.extend(others);
        self.reason = words.join("; ");
        self.caps = caps.into_iter().map(|cap| cap.record).collect();
        self
    }

    /// Says that people were not looked for, if nothing is found.
    fn with_advice(mut self, search: OperatorSearch) -> Self {
        if !search.people && self.finding != OperatorFinding::Found {
            self.reason += NO_PEOPLE;
        }
        self
    }
}

/// Describes a cap.
fn described(cap: &OperatorCap) -> String {
    let kind = match cap.kind {
        CapKind::Mount => "a mount",
        CapKind::Gap => "a gap between lenses",
    };
    let pole = match cap.pole {
        Pole::Zenith => "zenith",
        Pole::Nadir => "nadir",
    };
    let verb = match cap.finding {
        OperatorFinding::Found => "stays",
        _ => "may stay",
    };
    format!(
        "{kind} {verb} within {:.0} degrees of the {pole}",
        cap.radius_degrees
    )
}

fn judge(
    folder: &Path,
    sequence: &Sequence,
    search: OperatorSearch,
    progress: &dyn Progress,
) -> Result<SearchResult, CurateError> {
    if sequence.is_pinhole() {
        let reason = "perspective frames do not show what carries the camera";
        return Ok(SearchResult::unjudged(reason.to_owned(), 0));
    }
    let entries = &sequence.frames.entries;
    let times: Vec<f64> = entries.iter().map(|entry| entry.time_seconds).collect();
    let pairs = pairs(&times);
    if pairs.len() < LEAST_PAIRS {
        let reason = format!(
            "{} pairs of frames are {GAP_SECONDS} s apart, {LEAST_PAIRS} are needed",
            pairs.len()
        );
        return Ok(SearchResult::unjudged(reason, pairs.len()));
    }
    progress.begin("what the camera carries", Some(pairs.len() as u64));
    let read_pair = |&[first, second]: &[usize; 2]| {
        let pair = [
            read(folder, sequence, first)?,
            read(folder, sequence, second)?,
        ];
        progress.advance(1);
        Ok(pair)
    };
    let images: Result<Vec<[GreySphere; 2]>, CurateError> = pairs.iter().map(read_pair).collect();
    progress.end();
    let images = images?;
    let compared: Vec<[&GreySphere; 2]> = images.iter().map(|[a, b]| [a, b]).collect();
    let internal = |error: opencv::Error| CurateError::internal(folder, error);
    let caps = match search.caps {
        true => caps::find(&compared),
        false => Vec::new(),
    };
    let Some(evidence) = evidence::measure(&compared).map_err(internal)? else {
        let standing = SearchResult::unjudged("the camera stands".to_owned(), pairs.len());
        return Ok(standing.with_caps(caps));
    };
    let people = match search.people {
        true => Some(people::staying(folder, sequence, progress)?),
        false => None,
    };
    let result = match evidence.goes_by {
        GoesBy::Around => {
            let region = region::find(&evidence.stays, &evidence.sharp).map_err(internal)?;
            SearchResult::of(region, people, pairs.len())
        }
        GoesBy::Below => SearchResult::below(people, pairs.len()),
    };
    Ok(result.with_caps(caps).with_advice(search))
}

/// Returns pairs of frames that are far enough apart, spread over the sequence.
fn pairs(times: &[f64]) -> Vec<[usize; 2]> {
    let second = |first: usize| {
        let mut later = first + 1..times.len();
        later.find(|&later| times[later] - times[first] >= GAP_SECONDS - 1e-6)
    };
    let all = (0..times.len()).filter_map(|first| Some([first, second(first)?]));
    let all: Vec<[usize; 2]> = all.collect();
    let step = all.len().div_ceil(MOST_PAIRS).max(1);
    all.into_iter().step_by(step).collect()
}

fn read(folder: &Path, sequence: &Sequence, index: usize) -> Result<GreySphere, CurateError> {
    let path = folder.join(&sequence.frames.entries[index].file);
    let image = GreySphere::new(&RgbImage::read(&path)?, evidence::WIDTH);
    residual::smoothed(&image).map_err(|error| CurateError::internal(&path, error))
}

/// Returns the mask of a region at the size of the frames, and an image of the frame in the middle of the sequence.
fn draw(
    folder: &Path,
    sequence: &Sequence,
    region: &Region,
) -> Result<(Mask, RgbImage), CurateError> {
    let frames = &sequence.frames;
    let (width, height) = (frames.width as usize, frames.height as usize);
    let mask = region.mask.resized_to_nearest(width, height);
    let middle = &frames.entries[frames.entries.len() / 2];
    let panorama = RgbImage::read(&folder.join(&middle.file))?;
    let image = view::draw(&panorama, &mask);
    Ok((mask, image))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_a_second_apart_and_few() {
        let times: Vec<f64> = (0..100).map(|frame| f64::from(frame) * 0.25).collect();
        let found = pairs(&times);
        assert!((LEAST_PAIRS..=MOST_PAIRS).contains(&found.len()));
        assert!(found.iter().all(|&[first, second]| second - first == 4));
        assert!(pairs(&[0.0, 0.5]).is_empty());
        assert_eq!(pairs(&[0.0, 3.0, 6.0]), [[0, 1], [1, 2]]);
    }

    #[test]
    fn findings_follow_the_evidence() {
        let mask = |data: [u8; 2]| Mask::new(2, 1, data.to_vec());
        let judged = |evidence: f64, people: Option<Mask>| {
            let mask = mask([255, 0]);
            SearchResult::of(Some(Region { mask, evidence }), people, 9)
        };
        assert_eq!(judged(3.0, None).finding, OperatorFinding::Found);
        let doubtful = judged(1.0, None);
        assert_eq!(doubtful.finding, OperatorFinding::Doubtful);
        assert!(doubtful.region.is_some());
        let weak = judged(0.2, None);
        assert_eq!(weak.finding, OperatorFinding::Nothing);
        assert!(weak.region.is_none() && weak.reason.contains("0.20"));
        assert_eq!(
            SearchResult::of(None, None, 9).finding,
            OperatorFinding::Nothing
        );
        // People alone are enough, and a weak outline is not part of their mask.
        let people = || Some(mask([0, 255]));
        let marked = |found: SearchResult| found.region.map(|region| region.mask.data);
        assert_eq!(judged(0.2, people()).finding, OperatorFinding::Found);
        assert_eq!(marked(judged(0.2, people())), Some(vec![0, 255]));
        assert_eq!(marked(judged(3.0, people())), Some(vec![255, 255]));
        let too_few = || Some(mask([0, 0]));
        assert_eq!(judged(0.2, too_few()).finding, OperatorFinding::Nothing);
        let below = |people: Option<Mask>| SearchResult::below(people, 9).finding;
        assert_eq!(below(people()), OperatorFinding::Found);
        assert_eq!(below(too_few()), OperatorFinding::Unjudged);
        assert_eq!(below(None), OperatorFinding::Unjudged);
        let advised = |evidence: f64, people: bool| {
            let search = OperatorSearch {
                people,
                caps: false,
            };
            let found = judged(evidence, None).with_advice(search);
            found.reason.ends_with(NO_PEOPLE)
        };
        assert_eq!(
            [advised(0.2, false), advised(1.0, false), advised(0.2, true)],
            [true, true, false]
        );
        assert!(!advised(3.0, false));
    }

    #[test]
    fn found_caps_are_entered_and_doubtful_ones_are_asked_about() {
        let cap = |finding: OperatorFinding, data: [u8; 2]| Cap {
            record: OperatorCap {
                pole: Pole::Nadir,
                kind: CapKind::Gap,
                finding,
                radius_degrees: 20.0,
                change_staying_levels: 0.0,
                change_turning_levels: 0.0,
                border_share: 1.0,
                evidence: 0.0,
            },
            mask: Mask {
                width: 2,
                height: 1,
                data: data.to_vec(),
            },
        };
        let judged = |evidence: f64, caps: Vec<Cap>| {
            let mask = Mask {
                width: 2,
                height: 1,
                data: vec![255, 0],
            };
            let result = SearchResult::of(Some(Region { mask, evidence }), None, 9).with_caps(caps);
            assert_eq!(result.caps.len(), 1);
            (result.finding, result.region.map(|region| region.mask.data))
        };
        let (found, doubtful) = (OperatorFinding::Found, OperatorFinding::Doubtful);
        let low = [0, 255];
        // A region that is found keeps its mask, one that is doubtful or weak does not.
        let entered = judged(3.0, vec![cap(found, low)]);
        assert_eq!(entered, (found, Some(vec![255, 255])));
        for evidence in [1.0, 0.2] {
            let entered = judged(evidence, vec![cap(found, low)]);
            assert_eq!(entered, (found, Some(low.to_vec())));
        }
        let asked = |evidence: f64| judged(evidence, vec![cap(doubtful, low)]);
        assert_eq!(asked(3.0), (found, Some(vec![255, 0])));
        assert_eq!(asked(1.0), (doubtful, Some(vec![255, 0])));
        assert_eq!(asked(0.2), (doubtful, Some(low.to_vec())));
        let standing = SearchResult::unjudged("stands".to_owned(), 9);
        let standing = standing.with_caps(vec![cap(doubtful, low)]);
        assert_eq!(standing.finding, doubtful);
        assert!(standing.reason.ends_with("; stands"), "{}", standing.reason);
    }
}
