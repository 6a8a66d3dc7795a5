//! Kinds of tables of a published dataset, with their columns.

/// A column: its name, its types in Croissant's vocabulary, and its content.
pub(super) type Column = (&'static str, &'static [&'static str], &'static str);

pub(super) struct Kind {
    /// Name in the metadata and on hubs.
    pub(super) name: &'static str,
    /// Content of a row.
    pub(super) about: &'static str,
    pub(super) columns: &'static [Column],
    /// Types of the images that the column `file` names; empty where it names none.
    pub(super) images: &'static [&'static str],
    /// Work that the rows come from.
    pub(super) activity: &'static str,
}

const TEXT: &[&str] = &["sc:Text"];
const INTEGER: &[&str] = &["sc:Integer"];
const FLOAT: &[&str] = &["sc:Float"];
const LABEL: &[&str] = &["sc:Text", "cr:Label"];
const SEQUENCE: Column = ("sequence", TEXT, "id of the sequence");
const FRAME: Column = (
    "frame",
    INTEGER,
    "number of the frame in its sequence, from 0",
);
const TIME: Column = (
    "time_seconds",
    FLOAT,
    "timestamp in the source video, seconds",
);
const SCALE: Column = ("scale", TEXT, "unit of the world: metres or arbitrary");

pub(super) static SEQUENCES: Kind = Kind {
    name: "sequences",
    about: "a sequence, whose frames lie in its folder",
    columns: &[
        SEQUENCE,
        ("folder", TEXT, "its folder in the dataset"),
        ("source", TEXT, "file name of the source video"),
        ("begin_seconds", FLOAT, "its begin in the source, seconds"),
        ("end_seconds", FLOAT, "its end in the source, seconds"),
        ("duration_seconds", FLOAT, "its length, seconds"),
        (
            "source_width",
            INTEGER,
            "width of the source's panorama in pixels",
        ),
        (
            "source_height",
            INTEGER,
            "height of the source's panorama in pixels",
        ),
        ("frames", INTEGER, "sampled frames"),
        ("group", LABEL, "semantic group of the scene"),
        ("scene", LABEL, "scene category"),
        ("action", LABEL, "action class of the camera's wearer"),
        ("ego_motion", LABEL, "ego-motion class"),
        ("dynamics", LABEL, "level of dynamic content"),
        ("posed_frames", INTEGER, "frames with a camera pose"),
        (
            "poses",
            TEXT,
            "outcome of the pose validation, empty without poses",
        ),
    ],
    images: &[],
    activity: "admission, cuts at shot boundaries, removal of duplicates",
};
pub(super) static FRAMES: Kind = Kind {
    name: "frames",
    about: "a sampled frame",
    columns: &[
        SEQUENCE,
        FRAME,
        ("video", TEXT, "file name of the source video"),
        TIME,
        ("file", TEXT, "image in the dataset"),
    ],
    images: &["sc:ImageObject"],
    activity: "sampling of frames",
};
pub(super) static MASKS: Kind = Kind {
    name: "masks",
    about: "a mask of a frame, white where it holds",
    columns: &[
        SEQUENCE,
        FRAME,
        (
            "kind",
            TEXT,
            "moving, ignored (no part of the scene), class:NAME or object:NAME",
        ),
        ("file", TEXT, "mask image in the dataset"),
    ],
    images: &["cr:SegmentationMask", "sc:ImageObject"],
    activity: "masking of dynamic and of ignored regions",
};
pub(super) static POSES: Kind = Kind {
    name: "poses",
    about: "a camera pose: x_world = R x_camera + centre, camera axes x right, y down, z forward",
    columns: &[
        SEQUENCE,
        FRAME,
        TIME,
        ("rotation_w", FLOAT, "camera-to-world rotation, quaternion"),
        ("rotation_x", FLOAT, "camera-to-world rotation, quaternion"),
        ("rotation_y", FLOAT, "camera-to-world rotation, quaternion"),
        ("rotation_z", FLOAT, "camera-to-world rotation, quaternion"),
        ("centre_x", FLOAT, "camera centre in world units"),
        ("centre_y", FLOAT, "camera centre in world units"),
        ("centre_z", FLOAT, "camera centre in world units"),
        SCALE,
        (
            "validation",
            TEXT,
            "outcome of the pose validation of the sequence",
        ),
    ],
    images: &[],
    activity: "estimation or import of camera poses, and their validation",
};
pub(super) static POINTS: Kind = Kind {
    name: "points",
    about: "the world points of a sequence",
    columns: &[SEQUENCE, ("file", TEXT, "PLY file in the dataset"), SCALE],
    images: &[],
    activity: "estimation or import of world points",
};
pub(super) static ANNOTATIONS: Kind = Kind {
    name: "annotations",
    about: "a statement on a sequence",
    columns: &[
        SEQUENCE,
        (
            "property",
            TEXT,
            "scene, group, traversal, action, ego-motion, dynamics or caption",
        ),
        ("value", LABEL, "class or text"),
        (
            "author",
            TEXT,
            "person, program, or measured and its source",
        ),
    ],
    images: &[],
    activity: "annotation by people and programs, measurement of motion",
};
pub(super) static SPLITS: Kind = Kind {
    name: "splits",
    about: "the part of a frame in the split of a protocol",
    columns: &[
        SEQUENCE,
        ("protocol", TEXT, "name of the protocol"),
        FRAME,
        (
            "split",
            &["sc:Text", "cr:Split"],
            "input-view (training) or novel-view (test)",
        ),
    ],
    images: &[],
    activity: "division into input views and novel views",
};
