//! Numbers of input views that see the scene's points.

use std::fmt;

use omnilife_schemas::statistics::median;
use serde::Serialize;

/// Maximum median number of views for which Gaussians can fit all of them without fitting other views
/// (docs/results/quality.md).
const FEW_VIEWS: f64 = 8.0;

/// Evidence of coverage.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Coverage {
    /// Input views.
    pub input_views: usize,
    /// Median over points of the number of input views in which a scene point is visible and not masked; `None`
    /// without points.
    pub views_of_a_point: Option<f64>,
}

impl Coverage {
    /// Returns the coverage from the number of views in which each point is visible, of `looked_at` ones among
    /// `input_views`.
    pub(super) fn of(seen: &[usize], looked_at: usize, input_views: usize) -> Self {
        let scale = input_views as f64 / looked_at.max(1) as f64;
        let seen: Vec<f64> = seen.iter().map(|&views| scale * views as f64).collect();
        Self {
            input_views,
            views_of_a_point: median(&seen),
        }
    }

    /// Returns true if few views see most points.
    pub fn is_sparse(&self) -> bool {
        self.views_of_a_point
            .is_some_and(|views| views <= FEW_VIEWS)
    }
}

impl fmt::Display for Coverage {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.views_of_a_point {
            None => out.write_str("no scene points to tell by how many views they are seen"),
            Some(views) => write!(
                out,
                "half of the scene points are seen in {views:.1} of {} input views or fewer (limit {FEW_VIEWS})",
                self.input_views
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_median_up_to_the_limit_is_sparse() {
        // 30 of 60 views were examined.
        let sparse = Coverage::of(&[0, 4, 30], 30, 60);
        assert_eq!(sparse.views_of_a_point, Some(8.0));
        assert!(sparse.is_sparse() && sparse.to_string().contains("8.0 of 60"));
        assert!(!Coverage::of(&[0, 5, 30], 30, 60).is_sparse());
        let nothing = Coverage::of(&[], 30, 60);
        assert!(!nothing.is_sparse() && nothing.to_string().contains("no scene points"));
    }
}
