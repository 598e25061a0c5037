// Does a device keep the laws of devices/device.h? Tried out on the device itself, live, with a hand on it.
#pragma once

#include "devices/loop/servo_loop.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// What was found out about one law.
struct LawFinding {
  enum class Verdict : std::uint8_t { passed, failed, not_tested };
  struct Figure {
    std::string name;
    double value = kNaN;
    std::string unit;
  };

  std::string id;   ///< for programs; stays the same
  std::string law;  ///< a sentence about the device
  Verdict verdict = Verdict::not_tested;
  std::string detail;  ///< what was measured, what is wrong and what to do, or why it was not tested
  std::vector<Figure> figures;
};

const char* to_string(LawFinding::Verdict verdict) noexcept;

/// The person at the device, and who reads along. Nothing of it is called while a session runs.
class ConformanceUser {
 public:
  virtual ~ConformanceUser() = default;

  /// Whether somebody holds the device and can say what he feels.
  [[nodiscard]] virtual bool is_there() const = 0;
  /// A force comes next; waits for leave. False: leave it out.
  virtual bool allows(const std::string& force) = 0;
  /// Something to do without any force; waits until it is done. False: it was not done.
  virtual bool does(const std::string& request) = 0;
  /// Nothing when nobody can tell.
  virtual std::optional<bool> answers(const std::string& question) = 0;
  /// As soon as it is known.
  virtual void found(const LawFinding& finding) = 0;
};

struct ConformanceOptions {
  double rate_hz = 1000;      ///< of the servo loop
  double rest = 2;            ///< how long it is watched without force [s]
  double feel = 10;           ///< how long a spring is there to be felt [s]
  double max_force = 0.5;     ///< of every force that is tried; never more than the device's own [N]
  double max_velocity = 0.5;  ///< of the handle, at which every force ends [m/s]
  double ready_timeout = 30;  ///< [s]
  std::string no_forces;      ///< why none may be sent; empty: with the user's leave
  bool busy_machine = false;  ///< others take its time: durations are judged by medians, with wide margins
  bool realtime = true;       ///< ask for a real-time thread
};

struct ConformanceReport {
  DeviceInfo device;
  std::vector<LawFinding> findings;  ///< one for every law, in a fixed order
  bool interrupted = false;
  ZeroForce zero_force = ZeroForce::confirmed;  ///< the worst that is known after its last force and its closes

  [[nodiscard]] int count(LawFinding::Verdict verdict) const noexcept;
  [[nodiscard]] bool kept() const noexcept { return count(LawFinding::Verdict::failed) == 0; }
};

/// Opens the device, tries the laws, closes it, and opens it once more. Devices in virtual time are tried in theirs.
///
/// Every measurement is a session of the servo loop. Forces are asked for one after the other. They grow slowly from
/// nothing along one axis until the handle has moved by 2 mm, then stop it; they never pass `max_force`, end when the
/// handle is faster than `max_velocity`, 20 mm away or outside its workspace, fade in and out, and the first that ends
/// so is the last. `stop` ends it at any moment, as it ends a session. Zero force is what is sent last. Two laws need a
/// device to be wronged: a force that is not a number is sent for 20 ms, and the host pauses for 200 ms while a force
/// acts.
///
/// Throws what `open` throws, and Error(input) when an option is out of range.
ConformanceReport test_conformance(const std::function<std::unique_ptr<Device>()>& open,
                                   const ConformanceOptions& options, ConformanceUser& user, const StopRequest& stop);

}  // namespace haptrace
