#include "devices/vendor/force_dimension.h"

#include "base/error.h"
#include "devices/device_spec.h"
#include "devices/loop/clock.h"
#include "devices/loop/threaded_device.h"
#include "devices/vendor/find_plugged.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <fmt/format.h>
#include <mutex>
#include <optional>
#include <sys/utsname.h>
#include <thread>

namespace haptrace {
namespace {

constexpr const char* kForceDimension = "forcedimension";

// Sources: forces, and the workspaces of the sigma.7 and lambda.7, are from CHAI3D 3.3.0's table, whose workspace is a
// sphere. Other workspaces, resolutions and torques are commonly quoted data sheet figures.
constexpr double kFdTorque = 0.4;
constexpr std::array kFdModels{
    ForceDimensionModel{33, "omega.3", 12, 0, 0.055, 0.08, 0.08, 1e-5},
    ForceDimensionModel{34, "omega.6 (right)", 12, 0, 0.055, 0.08, 0.08, 1e-5},
    ForceDimensionModel{36, "omega.6 (left)", 12, 0, 0.055, 0.08, 0.08, 1e-5},
    ForceDimensionModel{35, "omega.7 (right)", 12, 0, 0.055, 0.08, 0.08, 1e-5},
    ForceDimensionModel{37, "omega.7 (left)", 12, 0, 0.055, 0.08, 0.08, 1e-5},
    ForceDimensionModel{63, "delta.3", 20, 0, 0.13, 0.2, 0.2, 2e-5},
    ForceDimensionModel{104, "sigma.7 (right)", 12, kFdTorque, 0.075, 0.075, 0.075, 0},
    ForceDimensionModel{105, "sigma.7 (left)", 12, kFdTorque, 0.075, 0.075, 0.075, 0},
    ForceDimensionModel{206, "sigma.3", 12, 0, 0.075, 0.075, 0.075, 0},
    ForceDimensionModel{108, "lambda.7 (right)", 12, kFdTorque, 0.1125, 0.1125, 0.1125, 0},
    ForceDimensionModel{109, "lambda.7 (left)", 12, kFdTorque, 0.1125, 0.1125, 0.1125, 0},
    ForceDimensionModel{203, "lambda.3", 12, 0, 0.1125, 0.1125, 0.1125, 0},
    ForceDimensionModel{60, "Novint Falcon", 8, 0, 0.04, 0.04, 0.04, 0},
};
constexpr int kFdFalcon = 60;

/// Indices into the result of dhdGetStatus.
enum FdStatus : std::size_t { kFdReset = 3, kFdForce = 5, kFdForceOffCause = 14, kFdStatusRoom = 32 };

/// Reasons why the device or its library switched the forces off, with remedies, indexed by the cause in dhdGetStatus.
constexpr std::array kFdForceOff{
    "its forces are off, and the library gives no reason; check that the device is switched on, and press its force "
    "button",
    "its force button was pressed; press it again to allow forces",
    "it moved faster than its own limit and switched its forces off; hold it, and start again",
    "it received nothing for so long that its watchdog switched the forces off; start again on a machine that is less "
    "busy (haptrace doctor)",
    "a program switched its forces off; end other programs that use it, and start again",
    "its USB connection broke, and it switched its forces off; check the cable, and start again",
    "no hand is on it (its dead man's switch is open); take the handle",
};

/// The vendor's C interface: the device's number is always its last argument, and results below 0 are errors. The
/// library keeps the text of the last error for each thread.
struct DhdApi {
  SharedLibrary library;

  void (*sdk_version)(int*, int*, int*, int*) = library.function("dhdGetSDKVersion");
  const char* (*last_error)() = library.function("dhdErrorGetLastStr");
  int (*device_count)() = library.function("dhdGetDeviceCount");
  int (*open)(char) = library.function("dhdOpenID");
  int (*open_serial)(int) = library.function("dhdOpenSerial");
  int (*close)(char) = library.function("dhdClose");
  int (*stop)(char) = library.function("dhdStop");
  int (*system_type)(char) = library.function("dhdGetSystemType");
  int (*status)(int*, char) = library.function("dhdGetStatus");
  int (*enable_force)(unsigned char, char) = library.function("dhdEnableForce");
  int (*position)(double*, double*, double*, char) = library.function("dhdGetPosition");
  int (*set_force)(double, double, double, char) = library.function("dhdSetForce");
  unsigned (*buttons)(char) = library.function("dhdGetButtonMask");
  int (*gravity_compensation)(int, char) = library.function("dhdSetGravityCompensation");

  // Functions that older libraries or simpler devices may lack.
  const char* (*system_name)(char) = library.function_if_any("dhdGetSystemName");
  int (*serial_number)(unsigned short*, char) = library.function_if_any("dhdGetSerialNumber");
  double (*max_force)(char) = library.function_if_any("dhdGetMaxForce");
  bool (*has_wrist)(char) = library.function_if_any("dhdHasWrist");
  bool (*has_active_wrist)(char) = library.function_if_any("dhdHasActiveWrist");
  bool (*has_gripper)(char) = library.function_if_any("dhdHasGripper");
  int (*pose)(double*, double*, double*, double (*)[3],
              char) = library.function_if_any("dhdGetPositionAndOrientationFrame");
  int (*set_wrench)(double, double, double, double, double, double, double,
                    char) = library.function_if_any("dhdSetForceAndTorqueAndGripperForce");
  int (*emulate_button)(unsigned char, char) = library.function_if_any("dhdEmulateButton");
  int (*enable_expert_mode)() = library.function_if_any("dhdEnableExpertMode");
  int (*set_watchdog)(unsigned char, char) = library.function_if_any("dhdSetWatchdog");
  int (*drd_open)(char) = library.function_if_any("drdOpenID");
  int (*drd_close)(char) = library.function_if_any("drdClose");
  bool (*drd_is_initialized)(char) = library.function_if_any("drdIsInitialized");
  int (*drd_auto_init)(char) = library.function_if_any("drdAutoInit");
  int (*drd_stop)(bool, char) = library.function_if_any("drdStop");
};

struct FdOptions {
  std::string text;  ///< complete text after --device
  WantedLibrary library;
  std::optional<int> serial;
  int index = 0;
  bool initialise = false;
  bool gravity_compensation = true;
  double max_force = 0;  ///< [N]; 0: the model's
};

class ForceDimensionDriver final : public DeviceDriver {
 public:
  explicit ForceDimensionDriver(const FdOptions& options);
  ~ForceDimensionDriver() override { (void)release(); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  [[nodiscard]] bool round(const Wrench& wrench, DeviceState& state) override;
  ZeroForce release() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;

  [[nodiscard]] std::string not_ready_reason() const override {
    const std::scoped_lock lock(reason_);
    return not_ready_;
  }

 private:
  static constexpr std::int64_t kLookNs = 20'000'000;  ///< time between two checks of the status
  static constexpr std::int64_t kBearNs = 50'000'000;  ///< longest time that errors are tolerated
  static constexpr std::int64_t kSwitchOnNs = 200'000'000;
  static constexpr unsigned char kWatchdog = 255;  ///< [125 us]: the longest, 32 ms

  void open(const FdOptions& options);
  void describe(const FdOptions& options);
  void initialise();
  [[nodiscard]] bool is_calibrated(const int* status) const;
  [[nodiscard]] bool look();
  [[nodiscard]] bool send(const Wrench& wrench) const;
  [[nodiscard]] bool fetch();
  bool bear(const char* call);
  [[nodiscard]] ZeroForce switch_off() const noexcept;
  [[nodiscard]] Error refuse(const std::string& why, const std::string& remedy) const;

  DhdApi api_;
  DeviceInfo info_;
  char id_ = 0;
  bool is_open_ = false, is_drd_ = false;
  ZeroForce released_ = ZeroForce::failed;
  bool has_wrist_ = false, has_active_wrist_ = false;
  double max_torque_ = 0;

  bool enabled_ = false, ready_ = false;
  bool has_watchdog_ = false, armed_ = false;
  std::int64_t look_ns_ = 0;                   ///< time of the next check of the status
  std::optional<std::int64_t> failing_since_;  ///< [ns]
  static constexpr int kTimeGuard = 1;         ///< result of a call too soon after the last, which it repeats
  DeviceState last_{.sequence = 1};
  mutable std::mutex reason_;  ///< guards not_ready_
  std::string not_ready_;
};

ForceDimensionDriver::ForceDimensionDriver(const FdOptions& options)
    : api_{SharedLibrary(options.library, SharedLibrary::Unload::never)} {
  info_.name = options.text;
  info_.backend = kForceDimension;
  try {
    open(options);
    describe(options);
    if (options.initialise) initialise();
    // Checks the status now, so that an obstacle becomes a note. Forces may take a while to come on.
    const std::int64_t begin = monotonic_ns();
    while (true) {
      if (!look()) throw refuse("it does not report its status", "check its cable and its power");
      if (ready_ || !enabled_ || monotonic_ns() - begin > kSwitchOnNs) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (!ready_) info_.notes.push_back(not_ready_);
  } catch (...) {
    (void)release();
    throw;
  }
}

Error ForceDimensionDriver::refuse(const std::string& why, const std::string& remedy) const {
  return device_error(fmt::format("{}: {}: {}; {}", info_.name, why, api_.last_error(), remedy));
}

void ForceDimensionDriver::open(const FdOptions& options) {
  if (const int devices = api_.device_count(); devices <= 0)
    throw refuse("its library was found, but no device was",
                 "plug it in, switch it on, and check the permissions with haptrace doctor");
  // The watchdog is one of the library's expert functions.
  if (api_.enable_expert_mode != nullptr) (void)api_.enable_expert_mode();

  int id = -1;
  if (options.serial) {
    id = api_.open_serial(*options.serial);
  } else {
    if (api_.drd_open != nullptr) id = api_.drd_open(static_cast<char>(options.index));
    is_drd_ = id >= 0;
    if (!is_drd_) id = api_.open(static_cast<char>(options.index));
  }
  if (id < 0)
    throw refuse(options.serial ? fmt::format("no device with serial number {} can be opened", *options.serial)
                                : fmt::format("device {} cannot be opened", options.index),
                 "end other programs that use it, and check the permissions with haptrace doctor");
  id_ = static_cast<char>(id);
  is_open_ = true;

  // Tries the watchdog now, so that its lack becomes a note. The first force arms it, so that a slow start does not
  // trip it.
  has_watchdog_ = api_.set_watchdog != nullptr && api_.set_watchdog(kWatchdog, id_) >= 0;
  if (has_watchdog_)
    (void)api_.set_watchdog(0, id_);
  else
    info_.notes.emplace_back(
        "its watchdog cannot be set: if this program is killed, the device may keep its last force; keep a hand on its "
        "switch");
  if (api_.gravity_compensation(options.gravity_compensation ? 1 : 0, id_) < 0)
    info_.notes.push_back(fmt::format("its gravity compensation cannot be set: {}", api_.last_error()));
}

void ForceDimensionDriver::describe(const FdOptions& options) {
  const int type = api_.system_type(id_);
  const ForceDimensionModel* model = force_dimension_model(type);
  if (model == nullptr && options.max_force <= 0)
    throw device_error(
        fmt::format("{}: haptrace does not know devices of type {}; state the largest force in newtons, for example "
                    "forcedimension:max_force=8",
                    info_.name, type));
  constexpr ForceDimensionModel kUnknown{-1, "unknown model", 0, 0, 0.04, 0.04, 0.04, 0};
  const ForceDimensionModel& known = model != nullptr ? *model : kUnknown;

  const char* name = api_.system_name != nullptr ? api_.system_name(id_) : nullptr;
  info_.model = fmt::format("Force Dimension {}", name != nullptr ? name : known.name);
  if (unsigned short number = 0; api_.serial_number != nullptr && api_.serial_number(&number, id_) >= 0)
    info_.serial = std::to_string(number);

  has_wrist_ = api_.pose != nullptr && api_.has_wrist != nullptr && api_.has_wrist(id_);
  has_active_wrist_ = api_.set_wrench != nullptr && api_.has_active_wrist != nullptr && api_.has_active_wrist(id_);
  max_torque_ = known.max_torque;
  info_.measures_orientation = has_wrist_;
  info_.torque_axes.fill(has_active_wrist_ && max_torque_ > 0);
  if (info_.takes_torque()) info_.max_torque = max_torque_;
  // DeviceState has no gripper, so the library makes a button of it.
  if (api_.emulate_button != nullptr && api_.has_gripper != nullptr && api_.has_gripper(id_))
    (void)api_.emulate_button(1, id_);

  if (model != nullptr && options.max_force > 0)
    check_range(fmt::format("--device '{}': max_force", options.text), options.max_force, 0, model->max_force, "N");
  info_.max_force = options.max_force > 0 ? options.max_force : known.max_force;
  if (const double allowed = api_.max_force != nullptr ? api_.max_force(id_) : 0; allowed > 0)
    info_.max_force = std::min(info_.max_force, allowed);
  info_.workspace_max = Vec3(known.width, known.height, known.depth);
  info_.workspace_min = -info_.workspace_max;
  info_.position_resolution = known.position_resolution;

  int version[4] = {};
  api_.sdk_version(&version[0], &version[1], &version[2], &version[3]);
  info_.notes.push_back(
      fmt::format("driven by {} (version {}.{}.{}); haptrace has not been tried with it on a real device yet, and the "
                  "limits are the published limits of the model",
                  api_.library.file(), version[0], version[1], version[2]));
}

/// Initialises the device by its motors, which move the handle.
void ForceDimensionDriver::initialise() {
  if (!is_drd_ || api_.drd_is_initialized == nullptr || api_.drd_auto_init == nullptr || api_.drd_stop == nullptr)
    throw device_error(
        fmt::format("{}: initialise: its library cannot initialise this device with its motors; leave out serial=, or "
                    "use the vendor's own program",
                    info_.name));
  if (api_.drd_is_initialized(id_)) return;
  const bool done = api_.drd_auto_init(id_) >= 0;
  const bool stopped = api_.drd_stop(true, id_) >= 0;  // the library's control loop would keep holding the handle
  if (!done || !stopped)
    throw refuse("it could not initialise itself", "remove everything from the handle, let go of it, and try again");
}

bool ForceDimensionDriver::is_calibrated(const int* status) const {
  return is_drd_ && api_.drd_is_initialized != nullptr ? api_.drd_is_initialized(id_) : status[kFdReset] == 0;
}

/// Checks whether the device is calibrated and allows forces. Returns false if it did not answer.
bool ForceDimensionDriver::look() {
  look_ns_ = monotonic_ns() + kLookNs;
  std::array<int, kFdStatusRoom> status{};  // the library writes 16 or 17
  if (api_.status(status.data(), id_) < 0) return false;

  std::string why;
  if (!is_calibrated(status.data())) {
    why = api_.system_type(id_) == kFdFalcon
              ? "it is not calibrated: pull its handle all the way out, and push it in"
              : "it is not calibrated: let go of it and run haptrace devices forcedimension:initialise=true; its "
                "motors then move the handle to its stops";
  } else {
    if (!enabled_) enabled_ = api_.enable_force(1, id_) >= 0;
    if (!enabled_) {
      why =
          fmt::format("its forces cannot be switched on: {}; check that the device is switched on", api_.last_error());
    } else if (api_.status(status.data(), id_) < 0) {
      return false;
    } else if (status[kFdForce] == 0) {
      const auto cause = static_cast<std::size_t>(status[kFdForceOffCause]);
      why = kFdForceOff[cause < kFdForceOff.size() ? cause : 0];
    }
  }
  ready_ = why.empty();
  const std::scoped_lock lock(reason_);
  not_ready_ = std::move(why);
  return true;
}

/// Sends a wrench. Results above 0 are no errors: either the device was spared an exchange (1, time guard) or a motor
/// gave less than requested (2).
bool ForceDimensionDriver::send(const Wrench& wrench) const {
  const Vec3 f = to_force_dimension(wrench.force);
  if (!has_active_wrist_) return api_.set_force(f.x(), f.y(), f.z(), id_) >= 0;
  const double norm = wrench.torque.norm();
  const Vec3 t = to_force_dimension(norm > max_torque_ ? Vec3(wrench.torque * (max_torque_ / norm)) : wrench.torque);
  return api_.set_wrench(f.x(), f.y(), f.z(), t.x(), t.y(), t.z(), 0, id_) >= 0;
}

bool ForceDimensionDriver::fetch() {
  Vec3 p_f;
  double rotation[3][3] = {};
  const int result = has_wrist_ ? api_.pose(&p_f.x(), &p_f.y(), &p_f.z(), rotation, id_)
                                : api_.position(&p_f.x(), &p_f.y(), &p_f.z(), id_);
  if (result < 0) return false;
  if (result != kTimeGuard) ++last_.sequence;
  last_.position = from_force_dimension(p_f);
  if (has_wrist_) last_.orientation = orientation_from_force_dimension(rotation);
  return true;
}

bool ForceDimensionDriver::round(const Wrench& wrench, DeviceState& state) {
  if (monotonic_ns() >= look_ns_ && !look()) return bear("dhdGetStatus");
  if (ready_ && !armed_ && !(wrench.force.isZero(0) && wrench.torque.isZero(0))) {
    armed_ = true;
    if (has_watchdog_) (void)api_.set_watchdog(kWatchdog, id_);
  }
  // After an error, only bear() sends anything, namely zero force, until a round succeeds.
  if (enabled_ && !failing_since_ && !send(ready_ ? wrench : Wrench{}) && ready_) return bear("dhdSetForce");
  // The position stays the same until the device is ready.
  if (ready_ && !fetch()) return bear("dhdGetPosition");
  failing_since_.reset();
  last_.buttons = api_.buttons(id_);
  last_.ready = ready_;
  state = last_;
  return true;
}

/// Handles an error of the library: sends zero force, and throws Error(device) if errors last longer than kBearNs.
/// Returns false.
bool ForceDimensionDriver::bear(const char* call) {
  const std::string why = api_.last_error();
  const std::int64_t now = monotonic_ns();
  if (enabled_) (void)send({});
  if (!failing_since_) failing_since_ = now;
  if (now - *failing_since_ > kBearNs)
    throw device_error(
        fmt::format("{} failed for {} ms: {}; check its cable and its power", call, kBearNs / 1'000'000, why));
  return false;
}

/// Switches the forces off and the brakes on. Returns `confirmed` if the library reports that the device accepted
/// either.
ZeroForce ForceDimensionDriver::switch_off() const noexcept {
  const bool off = api_.enable_force(0, id_) >= 0;
  const bool stopped = api_.stop(id_) >= 0;
  return off || stopped ? ZeroForce::confirmed : ZeroForce::failed;
}

ZeroForce ForceDimensionDriver::emergency_stop() noexcept {
  return switch_off();
}

ZeroForce ForceDimensionDriver::release() noexcept {
  if (!is_open_) return released_;
  is_open_ = false;
  if (enabled_ && send({})) released_ = ZeroForce::confirmed;
  if (switch_off() == ZeroForce::confirmed || !enabled_) released_ = ZeroForce::confirmed;
  (void)(is_drd_ && api_.drd_close != nullptr ? api_.drd_close(id_) : api_.close(id_));
  return released_;
}

std::unique_ptr<Device> open_force_dimension(const DeviceSpec& spec) {
  FdOptions options{.text = spec.text, .library = force_dimension_library(), .serial = {}};
  if (const std::string file = spec.option("library"); !file.empty()) options.library.places = {file};
  if (spec.options.contains("serial")) {
    if (spec.options.contains("index"))
      throw input_error(fmt::format("--device '{}': serial and index both select a device; leave one out", spec.text));
    options.serial = spec.number("serial", 0, 65535, 0);
  }
  options.index = spec.number("index", 0, 15, 0);
  options.initialise = spec.flag("initialise");
  options.gravity_compensation = spec.flag("gravity_compensation", true);
  options.max_force = spec.number("max_force", 0.0, 100.0, 0.0, "N");
  return std::make_unique<ThreadedDevice>(std::make_unique<ForceDimensionDriver>(options));
}

}  // namespace

Quat orientation_from_force_dimension(const double (&rotation)[3][3]) {
  // R_WT = P R_FT P', where P is the permutation from F to W and applies to T's axes alike.
  constexpr std::array<std::size_t, 3> kAxis{1, 2, 0};  // axis of F that each axis of W equals
  Eigen::Matrix3d r;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      r(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = rotation[kAxis[i]][kAxis[j]];
  return Quat(r).normalized();
}

const ForceDimensionModel* force_dimension_model(int type) {
  const auto* model = std::find_if(kFdModels.begin(), kFdModels.end(), [&](const auto& m) { return m.type == type; });
  return model != kFdModels.end() ? model : nullptr;
}

WantedLibrary force_dimension_library() {
  std::vector<std::string> folders;
  if (const char* sdk = std::getenv("FDSDK")) {
    utsname machine{};
    uname(&machine);
    folders.push_back(fmt::format("{}/lib/release/lin-{}-gcc", sdk, machine.machine));
    folders.push_back(fmt::format("{}/lib", sdk));
  }
  if (const char* home = std::getenv("HOME")) folders.push_back(fmt::format("{}/.local/lib", home));
  folders.emplace_back("/usr/local/lib");
  WantedLibrary wanted{.what = "Force Dimension's library libdrd",
                       .places = library_files(folders, "libdrd.so"),
                       .remedy =
                           "install the vendor's SDK (forcedimension.com) and libusb-1.0, and set FDSDK to its folder, "
                           "or name the file: forcedimension:library=/path/libdrd.so"};
  wanted.places.emplace_back("libdrd.so");
  return wanted;
}

DeviceBackend force_dimension_backend() {
  return {.name = kForceDimension,
          .summary = "omega, delta, sigma and lambda, through Force Dimension's own library",
          .options = {{"library", "path of the vendor's libdrd.so (default: search the usual folders)"},
                      {"serial", "serial number of the device, if there are several"},
                      {"index", "index of the device, if there are several, from 0"},
                      {"initialise", "true: let its motors move the handle to its stops if it is not calibrated"},
                      {"gravity_compensation", "false: switch off the library's gravity compensation"},
                      {"max_force", "force limit below that of the model [N]"}},
          .presets = {},
          .open = open_force_dimension,
          .find = [] { return find_plugged("Force Dimension", kForceDimension, force_dimension_library()); },
          .opens_still = true};
}

}  // namespace haptrace
