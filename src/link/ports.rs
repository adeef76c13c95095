//! The serial ports of this host.

use serialport::SerialPortType;
use std::fmt;
use std::path::Path;

/// A serial port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// What to open, such as `/dev/ttyUSB0`.
    pub path: String,
    /// What it is part of, if that is known.
    pub adapter: Adapter,
}

/// What a port is part of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Adapter {
    /// A USB adapter.
    Usb {
        /// Vendor's number.
        vendor: u16,
        /// Product's number.
        product: u16,
        /// Serial number.
        serial_number: Option<String>,
        /// Manufacturer and product in words.
        name: Option<String>,
    },
    /// A card.
    Pci,
    /// Bluetooth.
    Bluetooth,
    /// Not known.
    Unknown,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Adapter::Pci => f.write_str("PCI"),
            Adapter::Bluetooth => f.write_str("Bluetooth"),
            Adapter::Unknown => f.write_str("-"),
            Adapter::Usb {
                vendor,
                product,
                serial_number,
                name,
            } => {
                write!(f, "USB {vendor:04x}:{product:04x}")?;
                for text in [name, serial_number].into_iter().flatten() {
                    write!(f, " {text}")?;
                }
                Ok(())
            }
        }
    }
}

/// The ports that the system lists, by name.
///
/// # Errors
/// What the system says where it lists none.
pub fn ports() -> Result<Vec<Port>, String> {
    if cfg!(target_os = "linux") && !Path::new("/sys/class/tty").is_dir() {
        return Err("/sys/class/tty is not there: the system lists no serial ports".to_owned());
    }
    let found = serialport::available_ports().map_err(|error| error.to_string())?;
    let mut ports: Vec<Port> = found
        .into_iter()
        .map(|port| Port {
            path: port.port_name,
            adapter: match port.port_type {
                SerialPortType::UsbPort(usb) => {
                    let words = [usb.manufacturer, usb.product];
                    let words: Vec<String> = words.into_iter().flatten().collect();
                    Adapter::Usb {
                        vendor: usb.vid,
                        product: usb.pid,
                        serial_number: usb.serial_number,
                        name: (!words.is_empty()).then(|| words.join(" ")),
                    }
                }
                SerialPortType::PciPort => Adapter::Pci,
                SerialPortType::BluetoothPort => Adapter::Bluetooth,
                SerialPortType::Unknown => Adapter::Unknown,
            },
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(ports)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_in_order() {
        if let Ok(ports) = ports() {
            assert!(ports.is_sorted_by(|a, b| a.path <= b.path));
        }
    }

    #[test]
    fn adapters_in_words() {
        let usb = Adapter::Usb {
            vendor: 0x403,
            product: 0x6001,
            serial_number: Some("A1".into()),
            name: Some("FTDI RS-422".into()),
        };
        assert_eq!(usb.to_string(), "USB 0403:6001 FTDI RS-422 A1");
    }
}
