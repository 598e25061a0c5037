// Search for plugged-in Falcons and for obstacles to opening them.
#pragma once

#include "devices/registry.h"

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The kernel's driver for FTDI's serial ports, which a link may detach and reattach.
inline constexpr std::string_view kFtdiDriver = "ftdi_sio";

/// A Falcon that is plugged in.
struct FalconPort {
  std::string port;  ///< port of the bus and its hubs, as the kernel writes it: "1-1.2"
  std::string serial;
  int bus = 0, address = 0;  ///< as libusb numbers them
  std::string node;          ///< device file, for example "/dev/bus/usb/001/005"
  std::string driver;        ///< kernel driver that is bound to it; empty if there is none
  int refused = 0;           ///< errno if the node may not be opened; 0: it may
};

/// Returns all plugged-in Falcons from the kernel's files below `root`, without opening any.
std::vector<FalconPort> find_falcon_ports(const std::string& root = "/");

/// Returns the Falcon with this serial number and port; an empty text matches any. Throws Error(device) if there is
/// none, or several to choose from, with the texts after --device.
FalconPort choose_falcon_port(const std::vector<FalconPort>& ports, std::string_view serial, std::string_view port);

/// Returns `ports` in the form of DeviceBackend::find.
std::vector<FoundDevice> found_falcons(const std::vector<FalconPort>& ports);

/// Throws Error(device), with the remedy, if there is a known obstacle to opening the port.
void expect_open_falcon_port(const FalconPort& port);

}  // namespace haptrace
