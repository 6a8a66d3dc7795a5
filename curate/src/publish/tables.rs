//! Tables of a published dataset, one CSV file each: sequences, frames, masks, poses, points, annotations and splits.
//! Hubs show them, and the record sets of `croissant.json` read them. Without rows only the first is written.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    layout::{
        ANNOTATION_FILE, SCENE_FILE, SEQUENCE_FILE, SLICES_FILE, SLICES_FOLDER, SPLIT_FILE,
        STATISTICS_FOLDER, TABLES_FOLDER,
    },
    plain_text::for_spreadsheet,
    records::{Annotation, Scale, Scene, SegmentOutcome, Sequence, Slices, Split},
    store,
};

use super::{
    kinds::{ANNOTATIONS, FRAMES, Kind, MASKS, POINTS, POSES, SEQUENCES, SPLITS},
    statistics::{SequenceRow, Statistics, optional, status_name, table},
};
use crate::error::CurateError;

type Cells = Vec<String>;

pub(super) struct Table {
    pub(super) kind: &'static Kind,
    pub(super) file: String,
    pub(super) csv: String,
    /// Glob patterns of the images that it names.
    pub(super) images: BTreeSet<String>,
}

/// Columns of the tables that hubs read beside videos.
const VIDEO_COLUMNS: [&str; 8] = [
    "file_name",
    "sequence",
    "duration_seconds",
    "group",
    "scene",
    "action",
    "ego_motion",
    "dynamics",
];

/// Returns the tables of a dataset: that of sequences, then the others that have rows.
///
/// # Errors
/// When a record is missing or malformed.
pub(super) fn collect(folder: &Path, statistics: &Statistics) -> Result<Vec<Table>, CurateError> {
    let mut rows = Rows::default();
    for row in &statistics.rows {
        rows.add(folder, row)?;
    }
    let mut tables = vec![Table {
        kind: &SEQUENCES,
        file: format!("{STATISTICS_FOLDER}/sequences.csv"),
        csv: statistics.sequences_csv()?,
        images: BTreeSet::new(),
    }];
    for (kind, rows) in [
        (&FRAMES, rows.frames),
        (&MASKS, rows.masks),
        (&POSES, rows.poses),
        (&POINTS, rows.points),
        (&ANNOTATIONS, rows.annotations),
        (&SPLITS, rows.splits),
    ] {
        if !rows.is_empty() {
            tables.push(kind.table(&rows)?);
        }
    }
    Ok(tables)
}

impl Kind {
    fn table(&'static self, rows: &[Cells]) -> Result<Table, CurateError> {
        let head: Cells = self
            .columns
            .iter()
            .map(|column| column.0.to_owned())
            .collect();
        // The file is the last column of tables of images.
        let files = rows.iter().filter_map(|row| row.last());
        let images = files.filter(|_| !self.images.is_empty());
        Ok(Table {
            kind: self,
            file: format!("{TABLES_FOLDER}/{}.csv", self.name),
            csv: table(std::iter::once(&head).chain(rows))?,
            images: images.filter_map(|file| pattern(file)).collect(),
        })
    }
}

/// Returns the pattern of all files of a folder that have the extension of this one.
fn pattern(file: &str) -> Option<String> {
    let (folder, name) = file.rsplit_once('/')?;
    let (_, extension) = name.rsplit_once('.')?;
    // Brackets would be a set of characters.
    Some(format!("{}/*.{extension}", folder.replace('[', "[[]")))
}

#[derive(Default)]
struct Rows {
    frames: Vec<Cells>,
    masks: Vec<Cells>,
    poses: Vec<Cells>,
    points: Vec<Cells>,
    annotations: Vec<Cells>,
    splits: Vec<Cells>,
}

impl Rows {
    fn add(&mut self, folder: &Path, row: &SequenceRow) -> Result<(), CurateError> {
        let place = folder.join(&row.folder);
        let id = text(&row.sequence);
        let path = |file: &str| format!("{}/{file}", row.folder);
        let sequence: Sequence = store::read_record(&place.join(SEQUENCE_FILE))?;
        let scene: Option<Scene> = optional(&place.join(SCENE_FILE))?;
        // Poses belong to the images of the scene, which may be frames without distortion.
        let frames: Vec<(&str, f64)> = match &scene {
            Some(scene) => (scene.frames.iter())
                .map(|frame| (frame.image.as_str(), frame.time_seconds))
                .collect(),
            None => (sequence.frames.entries.iter())
                .map(|entry| (entry.file.as_str(), entry.time_seconds))
                .collect(),
        };
        for (index, (file, time)) in frames.into_iter().enumerate() {
            let (index, time) = (index.to_string(), time.to_string());
            self.frames
                .push(vec![id.clone(), index, text(&row.source), time, path(file)]);
        }
        if let Some(scene) = &scene {
            self.add_scene(scene, &id, path);
        }
        for (protocol, views) in splits(&place, scene.as_ref())? {
            for (views, split) in views.iter().zip(["input-view", "novel-view"]) {
                self.splits.extend(views.iter().map(|view| {
                    vec![
                        id.clone(),
                        text(&protocol),
                        view.to_string(),
                        split.to_owned(),
                    ]
                }));
            }
        }
        if let Some(annotation) = optional::<Annotation>(&place.join(ANNOTATION_FILE))? {
            self.add_annotation(&annotation, &id);
        }
        Ok(())
    }

    fn add_scene(&mut self, scene: &Scene, id: &str, path: impl Fn(&str) -> String) {
        let scale = match scene.scale {
            Scale::Metres => "metres",
            Scale::Arbitrary => "arbitrary",
        };
        for (index, frame) in scene.frames.iter().enumerate() {
            let begin = [id.to_owned(), index.to_string()];
            let of_frame = [("moving", &frame.mask), ("ignored", &frame.ignore_mask)];
            let of_frame = of_frame.into_iter().filter_map(|(kind, file)| {
                let file = file.as_ref()?;
                Some((kind.to_owned(), file))
            });
            let classes = frame.classes.iter();
            let classes = classes.map(|(name, file)| (format!("class:{name}"), file));
            let objects = frame.objects.iter();
            let objects = objects.map(|(name, file)| (format!("object:{name}"), file));
            for (kind, file) in of_frame.chain(classes).chain(objects) {
                self.masks.push([&begin[..], &[kind, path(file)]].concat());
            }
            if let Some(pose) = &frame.pose {
                let numbers = std::iter::once(&frame.time_seconds)
                    .chain(&pose.rotation_wxyz)
                    .chain(&pose.centre);
                let end = [scale, status_name(scene.validation.status)];
                let cells = begin.into_iter().chain(numbers.map(f64::to_string));
                self.poses
                    .push(cells.chain(end.map(str::to_owned)).collect());
            }
        }
        let points = scene.points.iter();
        self.points
            .extend(points.map(|file| vec![id.to_owned(), path(file), scale.to_owned()]));
    }

    fn add_annotation(&mut self, annotation: &Annotation, id: &str) {
        let mut add = |property: &str, value: &str, author: &str| {
            let cells = [id, property, &text(value), &text(author)];
            self.annotations.push(Vec::from(cells.map(str::to_owned)));
        };
        if let Some(scene) = &annotation.scene {
            add("scene", &scene.name, &scene.author);
            if let Some(group) = &annotation.group {
                add("group", group, &scene.author);
            }
            if annotation.traversal {
                add("traversal", "true", &scene.author);
            }
        }
        if let Some(action) = &annotation.action {
            add("action", &action.name, &action.author);
            if let Some(class) = &annotation.ego_motion.of_action {
                add("ego-motion", class, &action.author);
            }
        }
        for (property, measured) in [
            ("ego-motion", &annotation.ego_motion.measured),
            ("dynamics", &annotation.dynamics),
        ] {
            if let Some(measured) = measured {
                let author = format!("measured: {}", measured.from);
                add(property, &measured.class, &author);
            }
        }
        for caption in &annotation.captions {
            add("caption", &caption.text, &caption.author);
        }
    }
}

fn text(cell: &str) -> String {
    for_spreadsheet(cell).into_owned()
}

/// Returns input views and novel views by protocol.
fn splits(
    place: &Path,
    scene: Option<&Scene>,
) -> Result<BTreeMap<String, [Vec<u32>; 2]>, CurateError> {
    let mut splits = BTreeMap::new();
    if let Some(split) = scene.and_then(|scene| scene.published_split.as_ref()) {
        let views = [split.input_views.clone(), split.novel_views.clone()];
        splits.insert("published".to_owned(), views);
    }
    for name in store::names_in(place)? {
        if let Some(split) = optional::<Split>(&place.join(&name).join(SPLIT_FILE))? {
            splits.insert(name, [split.input_views, split.novel_views]);
        }
    }
    Ok(splits)
}

/// Returns the tables that hubs read beside the videos of sequences: files with contents.
///
/// # Errors
/// When a record is malformed.
pub(super) fn of_videos(
    folder: &Path,
    statistics: &Statistics,
) -> Result<Vec<(String, String)>, CurateError> {
    let mut files = Vec::new();
    for sequences in (statistics.rows).chunk_by(|one, next| video(one) == video(next)) {
        let Some(video) = sequences.first().map(video) else {
            continue;
        };
        let slices: Option<Slices> = optional(&folder.join(video).join(SLICES_FILE))?;
        let mut rows = vec![VIDEO_COLUMNS.map(str::to_owned)];
        for segment in slices.iter().flat_map(|slices| &slices.segments) {
            let SegmentOutcome::Kept { sequence, slice } = &segment.outcome else {
                continue;
            };
            let place = format!("{video}/{sequence}");
            let row = sequences.iter().find(|row| row.folder == place);
            if let (Some(row), Some(slice)) = (row, slice) {
                rows.push([
                    text(slice.file.rsplit('/').next().unwrap_or_default()),
                    text(&row.sequence),
                    row.duration_seconds.to_string(),
                    text(&row.group),
                    text(&row.scene),
                    text(&row.action),
                    text(&row.ego_motion),
                    text(&row.dynamics),
                ]);
            }
        }
        if rows.len() > 1 {
            files.push((
                format!("{video}/{SLICES_FOLDER}/metadata.csv"),
                table(&rows)?,
            ));
        }
    }
    Ok(files)
}

/// Returns the folder of a sequence's video.
fn video(row: &SequenceRow) -> &str {
    row.folder.rsplit_once('/').map_or("", |(video, _)| video)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_of_the_table_of_sequences_is_described() {
        let row = SequenceRow {
            sequence: "a/seq-000".to_owned(),
            folder: "videos/a/seq-000".to_owned(),
            source: "a.mp4".to_owned(),
            begin_seconds: 0.0,
            end_seconds: 1.0,
            duration_seconds: 1.0,
            source_width: 2,
            source_height: 1,
            frames: 1,
            group: "outdoor".to_owned(),
            scene: "street".to_owned(),
            action: "walking".to_owned(),
            ego_motion: "slow".to_owned(),
            dynamics: "low".to_owned(),
            posed_frames: 1,
            poses: "valid".to_owned(),
        };
        let table = table([&row]).expect("a table");
        let head: Vec<&str> = table
            .lines()
            .next()
            .unwrap_or_default()
            .split(',')
            .collect();
        let columns: Vec<&str> = SEQUENCES.columns.iter().map(|column| column.0).collect();
        assert_eq!(head, columns);
    }

    #[test]
    fn tables_of_images_end_with_the_file_and_list_its_folders() {
        for kind in [&FRAMES, &MASKS] {
            assert_eq!(kind.columns.last().map(|column| column.0), Some("file"));
        }
        let row = ["a", "0", "moving", "videos/a [4K]/seq-000/masks/0.png"];
        let made = MASKS
            .table(&[row.map(str::to_owned).to_vec()])
            .expect("rows fit");
        assert_eq!(
            Vec::from_iter(&made.images),
            ["videos/a [[]4K]/seq-000/masks/*.png"]
        );
        assert!(MASKS.table(&[vec!["too short".to_owned()]]).is_err());
    }
}
