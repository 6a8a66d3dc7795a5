//! A Kalman filter on the ground: the state is place and velocity in metres and metres per second, with constant
//! velocity and white acceleration. Both axes are alike, so that they share one covariance of place and velocity.

use glam::DVec2;

/// Spectral density of the acceleration: standard deviation of the velocity after a second, metres per
/// second. Cars brake and turn at up to 4 m/s^2.
const ACCELERATION: f64 = 2.0;
/// Standard deviation of the first velocity, metres per second.
const FIRST_SPEED: f64 = 6.0;

/// Estimated motion of an object at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Filter {
    seconds: f64,
    place: DVec2,
    velocity: DVec2,
    /// Variances of place and velocity along an axis, and their covariance.
    of_place: f64,
    of_velocity: f64,
    mixed: f64,
}

impl Filter {
    /// Starts a filter from one sighting, with the standard deviation of its place in metres.
    pub(super) fn new(seconds: f64, place: DVec2, sigma: f64) -> Self {
        Self {
            seconds,
            place,
            velocity: DVec2::ZERO,
            of_place: sigma * sigma,
            of_velocity: FIRST_SPEED * FIRST_SPEED,
            mixed: 0.0,
        }
    }

    /// Predicts the state, forwards or backwards in time.
    pub(super) fn at(&self, seconds: f64) -> Self {
        let dt = seconds - self.seconds;
        // White acceleration, integrated once and twice.
        let q = ACCELERATION * ACCELERATION;
        Self {
            seconds,
            place: self.place + self.velocity * dt,
            velocity: self.velocity,
            of_place: self.of_place
                + 2.0 * dt * self.mixed
                + dt * dt * self.of_velocity
                + q * dt.powi(3).abs() / 3.0,
            of_velocity: self.of_velocity + q * dt.abs(),
            mixed: self.mixed + dt * self.of_velocity + q * dt * dt.abs() / 2.0,
        }
    }

    /// Returns the place, metres.
    pub(super) fn place(&self) -> DVec2 {
        self.place
    }

    /// Returns the speed, metres per second.
    pub(super) fn speed(&self) -> f64 {
        self.velocity.length()
    }

    /// Returns the variance of the place along an axis, square metres.
    pub(super) fn spread(&self) -> f64 {
        self.of_place
    }

    /// Returns the squared Mahalanobis distance of a place measured with a standard deviation, and the variance along
    /// an axis.
    pub(super) fn distance(&self, place: DVec2, sigma: f64) -> (f64, f64) {
        let variance = self.of_place + sigma * sigma;
        (place.distance_squared(self.place) / variance, variance)
    }

    /// Returns the filter updated by a measured place.
    pub(super) fn updated(&self, place: DVec2, sigma: f64) -> Self {
        let variance = self.of_place + sigma * sigma;
        let (to_place, to_velocity) = (self.of_place / variance, self.mixed / variance);
        let difference = place - self.place;
        Self {
            seconds: self.seconds,
            place: self.place + to_place * difference,
            velocity: self.velocity + to_velocity * difference,
            of_place: self.of_place - to_place * self.of_place,
            of_velocity: self.of_velocity - to_velocity * self.mixed,
            mixed: self.mixed - to_place * self.mixed,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;

    #[test]
    fn a_straight_path_is_foreseen_and_certainty_grows() {
        let place = |seconds: f64| dvec2(3.0 - 7.0 * seconds, 1.0 + 2.0 * seconds);
        let mut filter = Filter::new(0.0, place(0.0), 0.5);
        let mut last = f64::INFINITY;
        for step in 1..6 {
            let seconds = f64::from(step);
            let (squared, variance) = filter.at(seconds).distance(place(seconds), 0.5);
            assert!(step == 1 || squared < 0.1, "{step}: {squared}");
            assert!(variance < 1.01 * last);
            last = variance;
            filter = filter.at(seconds).updated(place(seconds), 0.5);
        }
        // Back in time as well.
        assert!(filter.at(4.5).place().distance(place(4.5)) < 0.1);
    }
}
