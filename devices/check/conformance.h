// A test of the laws of devices/device.h on the device itself, live, with a hand on it.
#pragma once

#include "devices/loop/servo_loop.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Result for one law.
struct LawFinding {
  enum class Verdict : std::uint8_t { passed, failed, not_tested };
  struct Figure {
    std::string name;
    double value = kNaN;
    std::string unit;
  };

  std::string id;   ///< for programs; never changes
  std::string law;  ///< a sentence about the device
  Verdict verdict = Verdict::not_tested;
  std::string detail;  ///< the measurement, the fault and its remedy, or the reason why it was not tested
  std::vector<Figure> figures;
};

const char* to_string(LawFinding::Verdict verdict) noexcept;

/// The user at the device, and the reader of the findings. No function is called while a session runs.
class ConformanceUser {
 public:
  virtual ~ConformanceUser() = default;

  /// Returns true if a user holds the device and can answer questions.
  [[nodiscard]] virtual bool is_there() const = 0;
  /// Announces a force and waits for permission. Returns false if the force must be left out.
  virtual bool allows(const std::string& force) = 0;
  /// Requests an action without force and waits until it is done. Returns false if it was not done.
  virtual bool does(const std::string& request) = 0;
  /// Asks a question. Returns nothing if nobody can answer it.
  virtual std::optional<bool> answers(const std::string& question) = 0;
  /// Receives a finding as soon as it is known.
  virtual void found(const LawFinding& finding) = 0;
};

struct ConformanceOptions {
  double rate_hz = 1000;      ///< rate of the servo loop
  double rest = 2;            ///< duration of the measurement without force [s]
  double feel = 10;           ///< duration of the spring that the user feels [s]
  double max_force = 0.5;     ///< limit of every test force; never more than the device's own [N]
  double max_velocity = 0.5;  ///< speed of the handle at which every force ends [m/s]
  double ready_timeout = 30;  ///< [s]
  std::string no_forces;      ///< why no force may be sent; empty: the user decides
  bool busy_machine = false;  ///< other programs use the processor: judge durations by medians, with wide margins
  bool realtime = true;       ///< request a real-time thread
};

struct ConformanceReport {
  DeviceInfo device;
  std::vector<LawFinding> findings;  ///< one per law, in a fixed order
  bool interrupted = false;
  ZeroForce zero_force = ZeroForce::confirmed;  ///< worst result after the last force and after each close

  [[nodiscard]] int count(LawFinding::Verdict verdict) const noexcept;
  [[nodiscard]] bool kept() const noexcept { return count(LawFinding::Verdict::failed) == 0; }
};

/// Opens the device, tests the laws, closes it, and opens it again. Devices in virtual time are tested in virtual time.
///
/// Every measurement is a session of the servo loop. The user must allow each force. Forces grow slowly from zero along
/// one axis until the handle has moved by 2 mm, and then stop it. They fade in and out and never exceed `max_force`. A
/// force ends if the handle is faster than `max_velocity`, 20 mm away or outside its workspace; no force follows after
/// that. `stop` ends the test at any time, as it ends a session. Zero force is always sent last. Two laws need a
/// deliberate fault: the test sends NaN as a force for 20 ms, and the host pauses for 200 ms while a force acts.
///
/// Throws what `open` throws, and Error(input) if an option is out of range.
ConformanceReport test_conformance(const std::function<std::unique_ptr<Device>()>& open,
                                   const ConformanceOptions& options, ConformanceUser& user, const StopRequest& stop);

}  // namespace haptrace
