// Haply Inverse3, through Haply's Inverse Service: a program of the vendor's, on this machine, that speaks JSON over a
// WebSocket. It takes one message and answers one; the client sets the rate. A force lasts until the next message, or
// until none comes: silence is idle, by the service's own doing.
#pragma once

#include "devices/haply/inverse3_calibration.h"
#include "devices/haply/inverse3_messages.h"
#include "devices/loop/threaded_device.h"
#include "devices/registry.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

struct Inverse3Options {
  std::string name = "inverse3";             ///< for DeviceInfo
  std::string url = "ws://localhost:10001";  ///< ws://HOST[:PORT][/PATH]
  bool remote = false;                       ///< whether HOST may be another machine's address, in digits
  std::string events;     ///< as url, of the event channel; empty: port 10020 of the same host; "off": none
  std::string device_id;  ///< empty: the only one there is
  std::optional<InverseForceKey> force_key;  ///< none: by what the service says
  std::optional<Inverse3Calibration> calibration;
};

/// Connects to the service and waits for its inventory. Every step has a deadline; all together last 4 s at most.
/// Throws Error(device), with what to do, when no service answers, none or several arms are there, or the arm cannot be
/// used; Error(input) when the url cannot be read or leads to another machine.
///
/// The driver's round lasts some 10 ms at most. It throws when the service closes the connection, says what is no
/// message of such a service, refuses a command, no longer lists the arm, lists it without power, calibration or
/// readiness, or with another basis, mount, transform, handedness, preset or filter than when it was opened, and when
/// its event channel reports that the arm no longer does what it is told (InverseEvent::ends_control). Releasing it
/// sends zero force, and waits for that to be answered for 0.1 s at most.
std::unique_ptr<DeviceDriver> open_inverse3_driver(const Inverse3Options& options);

/// The arms of the service at `url`, and what keeps them from being used. None when no service is there. Lasts 0.2 s at
/// most, as long as one that answers nothing; does not throw.
std::vector<FoundDevice> find_inverse3(const std::string& url);

/// `inverse3`; with emulated=true in front of an emulated service.
DeviceBackend inverse3_backend();

}  // namespace haptrace
