//! The gallery of a dataset: a frame of every kind of sequence, and below it its moving content.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{ANNOTATION_FILE, DATASET_FILE, SCENE_FILE, SEQUENCE_FILE},
    records::{Annotation, Dataset, Scene, Sequence, VideoStatus},
    rgb::{Mask, RgbImage},
    store::{self, StoreError},
};
use rayon::prelude::*;

use super::{
    panels::{GAP, paste},
    svg, unusable, write_both,
};
use crate::error::LeaderboardError;

/// Colour over the pixels of a mask, and its opacity.
const TINT: [f32; 3] = [1.0, 0.25, 0.1];
const TINT_SHARE: f32 = 0.6;

/// Content and files of a gallery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GalleryRequest {
    /// Folder of a dataset, or its `dataset.json`.
    pub dataset: PathBuf,
    /// The figure without its ending: `.png` and `.svg` are written.
    pub out: PathBuf,
    /// Ids of the shown sequences; if empty, as many kinds of scene and motion as there are.
    pub sequences: Vec<String>,
    /// Maximum number of sequences if none are given.
    pub most: usize,
    /// Sequences beside each other.
    pub columns: usize,
    /// Width of a panel in pixels.
    pub panel_width: usize,
}

/// A gallery as drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gallery {
    /// Pixels alone.
    pub png: PathBuf,
    /// The same pixels with names.
    pub svg: PathBuf,
    /// The sequences, row by row.
    pub sequences: Vec<String>,
    /// Sequences of the dataset.
    pub of: usize,
}

/// Facts of a sequence that need no frames.
struct Entry {
    id: String,
    folder: PathBuf,
    /// Group and category of the scene, and class of the camera's motion.
    kind: [Option<String>; 3],
    duration_seconds: f64,
    image: String,
    mask: Option<String>,
}

/// Draws a gallery.
///
/// # Errors
/// When there is no such dataset or sequence, a record or an image cannot be read, or a file of that name exists
/// already.
pub fn gallery(request: &GalleryRequest) -> Result<Gallery, LeaderboardError> {
    let file = if request.dataset.is_dir() {
        request.dataset.join(DATASET_FILE)
    } else {
        request.dataset.clone()
    };
    let dataset: Dataset = store::read_record(&file)?;
    let entries = entries(&file, &dataset)?;
    let of = entries.len();
    let shown = chosen(request, &file, entries)?;
    let panels: Vec<Result<Panels, StoreError>> = shown
        .par_iter()
        .map(|entry| Panels::read(entry, request.panel_width))
        .collect();
    // In the order of the sequences, so that the named broken one is always the first.
    let panels = panels.into_iter().collect::<Result<Vec<_>, _>>()?;
    let sheet = Sheet::of(
        &panels,
        request.columns.min(panels.len()),
        request.panel_width,
    );
    let labels: Vec<[String; 2]> = shown.iter().map(Entry::label).collect();
    let size = [sheet.width, sheet.height];
    let [png, svg_file] = write_both(&request.out, size, &sheet.rgb, |pixels| {
        svg::gallery(&sheet, pixels, &labels)
    })?;
    Ok(Gallery {
        png,
        svg: svg_file,
        sequences: shown.into_iter().map(|entry| entry.id).collect(),
        of,
    })
}

/// Returns all existing sequences beside the file of a dataset, in its order.
fn entries(file: &Path, dataset: &Dataset) -> Result<Vec<Entry>, LeaderboardError> {
    let curated = dataset
        .videos
        .iter()
        .filter_map(|video| match &video.status {
            VideoStatus::Curated { sequences } => Some(sequences),
            _ => None,
        });
    let folders = curated.flatten().map(|folder| file.with_file_name(folder));
    folders
        .filter(|folder| folder.join(SEQUENCE_FILE).is_file())
        .filter_map(|folder| entry(folder).transpose())
        .collect()
}

/// Returns a sequence in a folder; none without frames.
fn entry(folder: PathBuf) -> Result<Option<Entry>, LeaderboardError> {
    let sequence: Sequence = store::read_record(&folder.join(SEQUENCE_FILE))?;
    let optional = |name: &str| Some(folder.join(name)).filter(|file| file.is_file());
    let annotation: Option<Annotation> = optional(ANNOTATION_FILE)
        .map(|file| store::read_record(&file))
        .transpose()?;
    let scene: Option<Scene> = optional(SCENE_FILE)
        .map(|file| store::read_record(&file))
        .transpose()?;
    let masks: BTreeMap<String, String> = scene
        .into_iter()
        .flat_map(|scene| scene.frames)
        .filter_map(|frame| Some((frame.image, frame.mask?)))
        .collect();
    let frames = &sequence.frames.entries;
    let middle = frames.len() / 2;
    let with_mask = (0..frames.len())
        .filter(|&at| masks.contains_key(&frames[at].file))
        .min_by_key(|at| at.abs_diff(middle));
    let Some(shown) = frames.get(with_mask.unwrap_or(middle)) else {
        return Ok(None);
    };
    let group = annotation.as_ref().and_then(|known| known.group.clone());
    let category = (annotation.as_ref()).and_then(|known| Some(known.scene.as_ref()?.name.clone()));
    let motion = annotation.and_then(|known| known.ego_motion.class().map(str::to_owned));
    Ok(Some(Entry {
        duration_seconds: sequence.range.duration_seconds(),
        image: shown.file.clone(),
        mask: masks.get(&shown.file).cloned(),
        id: sequence.id,
        kind: [group, category, motion],
        folder,
    }))
}

impl Entry {
    /// Returns two lines: the place, and motion and duration.
    fn label(&self) -> [String; 2] {
        let [group, category, motion] = &self.kind;
        let place = match (category, group) {
            (Some(category), Some(group)) => format!("{category} ({group})"),
            (Some(name), None) | (None, Some(name)) => name.clone(),
            (None, None) => self.id.clone(),
        };
        let length = format!("{:.0} s", self.duration_seconds);
        let motion = motion.as_ref().map(|class| format!("{class} ego-motion, "));
        [place, motion.unwrap_or_default() + &length]
    }
}

/// Returns the requested sequences; else one of every kind, then a second one, sorted by kind.
fn chosen(
    request: &GalleryRequest,
    file: &Path,
    entries: Vec<Entry>,
) -> Result<Vec<Entry>, LeaderboardError> {
    if entries.is_empty() {
        return Err(unusable(file, "has no sequence with frames".to_owned()));
    }
    if !request.sequences.is_empty() {
        let mut known: BTreeMap<String, Entry> = (entries.into_iter())
            .map(|entry| (entry.id.clone(), entry))
            .collect();
        return (request.sequences.iter())
            .map(|id| {
                known.remove(id).ok_or_else(|| {
                    unusable(file, format!("has no sequence {id}, or it was named twice"))
                })
            })
            .collect();
    }
    let mut seen: BTreeMap<[Option<String>; 3], usize> = BTreeMap::new();
    let mut ranked: Vec<(usize, Entry)> = (entries.into_iter())
        .map(|entry| {
            let before = seen.entry(entry.kind.clone()).or_default();
            *before += 1;
            (*before, entry)
        })
        .collect();
    ranked.sort_by_key(|(before, _)| *before);
    ranked.truncate(request.most);
    ranked.sort_by(|(_, a), (_, b)| (&a.kind, &a.id).cmp(&(&b.kind, &b.id)));
    Ok(ranked.into_iter().map(|(_, entry)| entry).collect())
}

/// A frame, and the same with its moving content in colour if a mask is known.
struct Panels {
    frame: RgbImage,
    marked: Option<RgbImage>,
}

impl Panels {
    fn read(entry: &Entry, width: usize) -> Result<Self, StoreError> {
        let image = RgbImage::read(&entry.folder.join(&entry.image))?;
        let height = (width * image.height / image.width).max(1);
        let frame = image.resized_by_area(width, height);
        let mask = (entry.mask.as_ref())
            .map(|mask| Mask::read(&entry.folder.join(mask)))
            .transpose()?;
        let marked = mask.map(|mask| marked(image, &mask).resized_by_area(width, height));
        Ok(Self { frame, marked })
    }
}

/// Colours the pixels of a mask. Masks may be of another size than the image.
fn marked(mut image: RgbImage, mask: &Mask) -> RgbImage {
    let mask = mask.resized_to_nearest(image.width, image.height);
    for (pixel, &marks) in image.data.chunks_exact_mut(3).zip(&mask.data) {
        if marks != 0 {
            for (value, tint) in pixel.iter_mut().zip(TINT) {
                *value = (1.0 - TINT_SHARE) * *value + TINT_SHARE * tint;
            }
        }
    }
    image
}

/// The gallery's pixels.
pub(super) struct Sheet {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Interleaved, 8 bits.
    rgb: Vec<u8>,
    /// Sequences beside each other.
    pub(super) columns: usize,
    pub(super) panel_width: usize,
    /// Upper edges of the rows, and their heights.
    pub(super) rows: Vec<[usize; 2]>,
}

impl Sheet {
    fn of(panels: &[Panels], columns: usize, panel_width: usize) -> Self {
        let mut rows = Vec::new();
        let mut height = 0;
        for row in panels.chunks(columns) {
            let of_frames = row.iter().map(|panels| panels.frame.height).max();
            let of_marked = row
                .iter()
                .filter_map(|panels| Some(GAP + panels.marked.as_ref()?.height))
                .max();
            let row_height = of_frames.unwrap_or(0) + of_marked.unwrap_or(0);
            rows.push([height, row_height]);
            height += row_height + GAP;
        }
        let (width, height) = (columns * (panel_width + GAP) - GAP, height - GAP);
        let mut sheet = Self {
            width,
            height,
            rgb: vec![255; width * height * 3],
            columns,
            panel_width,
            rows,
        };
        for (at, panels) in panels.iter().enumerate() {
            let left = at % columns * (panel_width + GAP);
            let [top, _] = sheet.rows[at / columns];
            paste(&mut sheet.rgb, width, &panels.frame, [left, top]);
            if let Some(marked) = &panels.marked {
                let below = top + panels.frame.height + GAP;
                paste(&mut sheet.rgb, width, marked, [left, below]);
            }
        }
        sheet
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(id: &str, category: &str, motion: &str) -> Entry {
        Entry {
            id: id.to_owned(),
            folder: PathBuf::new(),
            kind: [
                Some("outdoor".to_owned()),
                Some(category.to_owned()),
                Some(motion.to_owned()),
            ],
            duration_seconds: 97.6,
            image: String::new(),
            mask: None,
        }
    }

    #[test]
    fn one_of_every_kind_comes_before_a_second_one() {
        let entries = || {
            vec![
                entry("a", "street", "low"),
                entry("b", "street", "low"),
                entry("c", "beach", "high"),
                entry("d", "street", "high"),
            ]
        };
        let mut request = GalleryRequest {
            dataset: PathBuf::new(),
            out: PathBuf::new(),
            sequences: Vec::new(),
            most: 3,
            columns: 2,
            panel_width: 64,
        };
        let ids = |request: &GalleryRequest| {
            let chosen = chosen(request, Path::new("dataset.json"), entries());
            chosen.map(|shown| {
                shown
                    .iter()
                    .map(|entry| entry.id.clone())
                    .collect::<Vec<_>>()
            })
        };
        assert_eq!(ids(&request).unwrap_or_default(), ["c", "d", "a"]);
        request.sequences = ["b", "a"].map(str::to_owned).to_vec();
        assert_eq!(ids(&request).unwrap_or_default(), ["b", "a"]);
        request.sequences.push("x".to_owned());
        let message = ids(&request).map_err(|error| error.to_string());
        assert!(message.is_err_and(|text| text.contains("dataset.json: has no sequence x")));
        let label = entry("a", "street", "low").label();
        assert_eq!(label, ["street (outdoor)", "low ego-motion, 98 s"]);
    }

    #[test]
    fn what_a_mask_marks_is_coloured_below_the_frame() {
        let mut image = RgbImage::black(8, 4);
        image.data.fill(0.5);
        let mut mask = Mask::new(4, 2, vec![0; 8]);
        mask.data[3] = 255;
        let with_mask = Panels {
            marked: Some(marked(image.clone(), &mask)),
            frame: image.clone(),
        };
        let without = Panels {
            frame: image,
            marked: None,
        };
        let sheet = Sheet::of(&[with_mask, without], 2, 8);
        assert_eq!((sheet.width, sheet.height), (8 + GAP + 8, 4 + GAP + 4));
        let pixel = |x: usize, y: usize| &sheet.rgb[(y * sheet.width + x) * 3..][..3];
        assert_eq!(pixel(7, 0), [128; 3]);
        assert_eq!(pixel(7, 4 + GAP), [204, 89, 66]);
        assert_eq!(pixel(0, 4 + GAP), [128; 3]);
        assert_eq!(pixel(8 + GAP, 4 + GAP), [255; 3], "no mask, no panel");
    }
}
