//! Required inputs of a method beside posed frames and a split.

/// A required input of a method beside posed frames and a split. A method's row lists them, and every command
/// that runs methods walks the list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Requirement {
    /// A camera that moves, so that its views determine places in space, or one that hovers over planar ground. It
    /// cannot be prepared: a scene without it is refused.
    Parallax,
    /// Points of perspective scenes, dense enough to separate dynamic from static regions.
    DensePoints,
    /// Tracks of vehicles beside the split.
    Tracks,
}

impl Requirement {
    /// Returns a noun for messages and lists.
    pub fn name(self) -> &'static str {
        match self {
            Self::Parallax => "a camera that moves, or hovers over planar ground",
            Self::DensePoints => "dense points of perspective scenes",
            Self::Tracks => "tracks of vehicles",
        }
    }
}
