// Driver of the Haply Inverse3 through Haply's Inverse Service: a program of the vendor on this machine that exchanges
// JSON over a WebSocket. The service answers each message with one; the client sets the rate. A force lasts until the
// next message; if none comes, the service idles by itself.
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
  std::string name = "inverse3";             ///< DeviceInfo::name
  std::string url = "ws://localhost:10001";  ///< ws://HOST[:PORT][/PATH]
  bool remote = false;                       ///< HOST may be the numeric address of another machine
  std::string events;     ///< URL of the event channel; empty: port 10020 of the same host; "off": none
  std::string device_id;  ///< empty: the only arm there is
  std::optional<InverseForceKey> force_key;  ///< none: derived from the service's messages
  std::optional<Inverse3Calibration> calibration;
};

/// Connects to the service and waits for its inventory. Every step has a deadline; all together last 4 s at most.
/// Throws Error(device), with the remedy, if no service answers, if there is no arm or several, or if the arm cannot be
/// used. Throws Error(input) if the URL is invalid or leads to another machine.
///
/// A round of the driver lasts some 10 ms at most. It throws if the service closes the connection, sends an invalid
/// message, refuses a command, or no longer lists the arm. It also throws if the service lists the arm as not powered,
/// calibrated or ready, or with another basis, mount, transform, handedness, preset or filter than at its opening. And
/// it throws if the event channel reports that the arm no longer follows commands (InverseEvent::ends_control).
/// release() sends zero force and waits 0.1 s at most for the answer.
std::unique_ptr<DeviceDriver> open_inverse3_driver(const Inverse3Options& options);

/// Returns the arms of the service at `url` and the obstacles to using them; none if there is no service. Lasts 0.2 s
/// at most, which a service that does not answer takes. Does not throw.
std::vector<FoundDevice> find_inverse3(const std::string& url);

/// Returns the backend `inverse3`; with emulated=true it uses an emulated service.
DeviceBackend inverse3_backend();

}  // namespace haptrace
