//! Dual numbers: values with their derivatives by some variables, for functions with a long chain rule.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Scalar type of the splines: numbers with or without derivatives.
pub(super) trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    fn constant(value: f64) -> Self;
    fn value(self) -> f64;
    /// Applies a function, given its value and its derivative at this number.
    fn map(self, value: f64, derivative: f64) -> Self;

    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.map(root, 0.5 / root)
    }
    fn sin(self) -> Self {
        let value = self.value();
        self.map(value.sin(), value.cos())
    }
    fn cos(self) -> Self {
        let value = self.value();
        self.map(value.cos(), -value.sin())
    }
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn map(self, value: f64, _derivative: f64) -> Self {
        value
    }
}

/// A number with its derivatives by `N` variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dual<const N: usize> {
    pub(super) value: f64,
    pub(super) by: [f64; N],
}

impl<const N: usize> Dual<N> {
    pub(super) fn variable(value: f64, number: usize) -> Self {
        let mut by = [0.0; N];
        by[number] = 1.0;
        Self { value, by }
    }

    fn combined(self, other: Self, value: f64, own: f64, others: f64) -> Self {
        let by = std::array::from_fn(|at| own * self.by[at] + others * other.by[at]);
        Self { value, by }
    }
}

impl<const N: usize> Number for Dual<N> {
    fn constant(value: f64) -> Self {
        let by = [0.0; N];
        Self { value, by }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn map(self, value: f64, derivative: f64) -> Self {
        let by = self.by.map(|by| derivative * by);
        Self { value, by }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.combined(other, self.value + other.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.combined(other, self.value - other.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.combined(other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        self.combined(other, value, 1.0 / other.value, -value / other.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.map(-self.value, -1.0)
    }
}
