//! List of the GPUs of this machine.
//!
//! Listing them opens no device and needs no GPU: without a Vulkan loader (or Metal, or DX12) the list is
//! empty.

use std::fmt;

/// A GPU that wgpu can open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterSummary {
    /// The adapter's name as its driver gives it.
    pub name: String,
    /// Graphics API: `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// Name and version of the driver; empty if it does not report them.
    pub driver: String,
    /// Hardware or software.
    pub kind: AdapterKind,
}

impl AdapterSummary {
    pub(crate) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            driver: format!("{} {}", info.driver, info.driver_info)
                .trim()
                .to_owned(),
            name: info.name,
            backend: info.backend.to_str().to_owned(),
            kind: info.device_type.into(),
        }
    }
}

/// Kind of device behind an adapter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdapterKind {
    /// A GPU with memory of its own.
    DiscreteGpu,
    /// A GPU that shares the CPU's memory.
    IntegratedGpu,
    /// A GPU lent to a virtual machine.
    VirtualGpu,
    /// A program on the CPU, such as Mesa's lavapipe.
    Software,
    /// Not reported by the driver.
    Unknown,
}

impl AdapterKind {
    /// Returns true if the work would run on the CPU.
    pub fn is_software(self) -> bool {
        self == Self::Software
    }
}

impl From<wgpu::DeviceType> for AdapterKind {
    fn from(kind: wgpu::DeviceType) -> Self {
        match kind {
            wgpu::DeviceType::DiscreteGpu => Self::DiscreteGpu,
            wgpu::DeviceType::IntegratedGpu => Self::IntegratedGpu,
            wgpu::DeviceType::VirtualGpu => Self::VirtualGpu,
            wgpu::DeviceType::Cpu => Self::Software,
            wgpu::DeviceType::Other => Self::Unknown,
        }
    }
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::DiscreteGpu => "discrete GPU",
            Self::IntegratedGpu => "integrated GPU",
            Self::VirtualGpu => "virtual GPU",
            Self::Software => "software",
            Self::Unknown => "unknown kind",
        })
    }
}

/// Lists all adapters of the backends that this build can use, hardware first.
///
/// Empty without a driver or loader. Opens no device and prints nothing.
pub fn adapters() -> Vec<AdapterSummary> {
    wgpu_adapters().iter().map(AdapterSummary::of).collect()
}

/// Lists the adapters behind [`adapters`], in the same order.
pub(crate) fn wgpu_adapters() -> Vec<wgpu::Adapter> {
    let backends = wgpu::Instance::enabled_backend_features();
    if backends.is_empty() {
        return Vec::new();
    }
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends,
        // Debug builds would otherwise ask for validation layers, which a list does not need.
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut found = pollster::block_on(instance.enumerate_adapters(backends));
    found.sort_by_key(|adapter| AdapterKind::from(adapter.get_info().device_type).is_software());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_adapter_says_what_it_is() {
        let found = adapters();
        if found.is_empty() {
            println!("no adapter on this machine: nothing to check");
        }
        for adapter in &found {
            println!("{adapter:?}");
            assert!(!adapter.name.is_empty());
            assert!(["vulkan", "metal", "dx12"].contains(&adapter.backend.as_str()));
        }
        assert!(
            found.is_sorted_by_key(|adapter| adapter.kind.is_software()),
            "hardware comes first"
        );
    }

    #[test]
    fn only_a_cpu_is_software() {
        let software = [
            wgpu::DeviceType::DiscreteGpu,
            wgpu::DeviceType::IntegratedGpu,
            wgpu::DeviceType::VirtualGpu,
            wgpu::DeviceType::Other,
            wgpu::DeviceType::Cpu,
        ]
        .map(|kind| AdapterKind::from(kind).is_software());
        assert_eq!(software, [false, false, false, false, true]);
    }
}
