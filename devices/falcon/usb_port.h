// Where Falcons are plugged in, and what is in the way of opening them.
#pragma once

#include "devices/registry.h"

#include <string>
#include <string_view>
#include <vector>

namespace haptrace {

/// The kernel's driver for serial ports of FTDI's chips, which a link may put aside and give back.
inline constexpr std::string_view kFtdiDriver = "ftdi_sio";

/// A Falcon that is plugged in.
struct FalconPort {
  std::string port;  ///< of the bus and its hubs, as the kernel writes it: "1-1.2"
  std::string serial;
  int bus = 0, address = 0;  ///< as libusb counts them
  std::string node;          ///< by which it is opened: "/dev/bus/usb/001/005"
  std::string driver;        ///< of the kernel, that has it now; empty when none has
  int refused = 0;           ///< why the node may not be opened, an errno; 0: it may
};

/// All of them, by what the kernel says below `root`, without touching any.
std::vector<FalconPort> find_falcon_ports(const std::string& root = "/");

/// The one that has this serial number and this port; an empty one says nothing. Throws Error(device) when there is
/// none, or when there are several to choose from, with what to say after --device.
FalconPort choose_falcon_port(const std::vector<FalconPort>& ports, std::string_view serial, std::string_view port);

/// As DeviceBackend::find says them.
std::vector<FoundDevice> found_falcons(const std::vector<FalconPort>& ports);

/// Throws Error(device), with the remedy, when something is known to be in the way of opening it.
void expect_open_falcon_port(const FalconPort& port);

}  // namespace haptrace
