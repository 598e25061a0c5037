#include "devices/vendor/open_haptics.h"

#include "base/error.h"
#include "base/mailbox.h"
#include "devices/device_spec.h"
#include "devices/loop/clock.h"
#include "devices/loop/loose_thread.h"
#include "devices/loop/threaded_device.h"
#include "devices/vendor/find_plugged.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fmt/format.h>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

constexpr const char* kOpenHaptics = "openhaptics";

// ---- the vendor's C interface ----

using HdHandle = unsigned;
using HdEnum = unsigned;
using HdSchedulerHandle = unsigned long;
using HdCallback = unsigned (*)(void*);

struct HdErrorInfo {
  unsigned code;  ///< 0: none. Other codes differ between versions, so only their text is used
  int internal;
  HdHandle device;
};

constexpr HdHandle kHdInvalid = 0xffffffff;
constexpr unsigned kHdGoOn = 1;  // result of a callback that is to be called again
constexpr unsigned short kHdHighestPriority = 0xffff;

enum HdParameter : HdEnum {
  kHdButtons = 0x2000,
  kHdPosition = 0x2050,
  kHdVelocity = 0x2051,
  kHdTransform = 0x2052,
  kHdVersion = 0x2500,
  kHdModel = 0x2501,
  kHdSerial = 0x2504,
  kHdMaxWorkspace = 0x2550,
  kHdUsableWorkspace = 0x2551,
  kHdOutputDof = 0x2554,
  kHdCalibrationStyle = 0x2555,
  kHdMaxForce = 0x2603,
  kHdMaxContinuousForce = 0x2604,
  kHdVelocityLimit = 0x2606,
  kHdImpulseLimit = 0x2607,
  kHdRampingRate = 0x2608,
  kHdForce = 0x2700,
  kHdTorqueOut = 0x2701,
  kHdForceOutput = 0x4000,
  kHdMaxForceClamping = 0x4001,
  kHdCalibrated = 0x5000,
  kHdNeedsUpdate = 0x5001,
};

enum HdCalibrationStyle { kHdEncoderReset = 1, kHdAuto = 2, kHdInkwell = 4 };

struct HdApi {
  SharedLibrary library;

  HdHandle (*init_device)(const char*) = library.function("hdInitDevice");
  void (*disable_device)(HdHandle) = library.function("hdDisableDevice");
  void (*make_current)(HdHandle) = library.function("hdMakeCurrentDevice");
  void (*begin_frame)(HdHandle) = library.function("hdBeginFrame");
  void (*end_frame)(HdHandle) = library.function("hdEndFrame");
  HdErrorInfo (*get_error)() = library.function("hdGetError");
  const char* (*error_string)(unsigned) = library.function("hdGetErrorString");
  const char* (*get_string)(HdEnum) = library.function("hdGetString");
  void (*get_integers)(HdEnum, int*) = library.function("hdGetIntegerv");
  void (*get_doubles)(HdEnum, double*) = library.function("hdGetDoublev");
  void (*set_doubles)(HdEnum, const double*) = library.function("hdSetDoublev");
  void (*enable)(HdEnum) = library.function("hdEnable");
  void (*disable)(HdEnum) = library.function("hdDisable");
  unsigned (*check_calibration)() = library.function("hdCheckCalibration");
  void (*update_calibration)(HdEnum) = library.function("hdUpdateCalibration");
  void (*start_scheduler)() = library.function("hdStartScheduler");
  void (*stop_scheduler)() = library.function("hdStopScheduler");
  void (*set_scheduler_rate)(unsigned long) = library.function("hdSetSchedulerRate");
  HdSchedulerHandle (*schedule)(HdCallback, void*, unsigned short) = library.function("hdScheduleAsynchronous");
  void (*unschedule)(HdSchedulerHandle) = library.function("hdUnschedule");

  /// Returns the text of the oldest error since the last call; null if there was none.
  [[nodiscard]] const char* error() const noexcept {
    const char* first = nullptr;
    for (int k = 0; k < 16; ++k) {
      const HdErrorInfo info = get_error();
      if (info.code == 0) break;
      if (first == nullptr) first = error_string(info.code);
      if (first == nullptr) first = "an error without a name";
    }
    return first;
  }
};

// ---- the device ----

struct HdOptions {
  std::string text;  ///< complete text after --device
  WantedLibrary library;
  std::string name;        ///< device name in the vendor's set-up; empty: the default
  unsigned long rate = 0;  ///< [Hz]; 0: HD's own
  bool reset_encoders = false;
};

std::atomic_flag hd_in_use;  // HD's scheduler belongs to one device at a time

// Bounds of close() [s], which also waits 0.1 s for the last frame.
constexpr double kLongestCalibration = 0.5;  // within kLongestShutDown
constexpr double kLongestShutDown = 2;
static_assert(kLongestShutDown + 0.1 < Device::kLongestClose);

/// Everything that the library's threads use. They own it together with the device, because the library may keep them
/// for ever.
class HdServo {
 public:
  struct Order {
    Wrench wrench;
    std::int64_t until_ns = 0;  ///< end of the wrench
  };
  struct Answer {
    DeviceState state;
    std::int64_t taken_ns = 0;        ///< time of the state
    std::int64_t frame_ns = 0;        ///< time of the last frame, with or without an error
    std::int64_t fault_ns = 0;        ///< time of the last error; 0: none
    std::int64_t fault_since_ns = 0;  ///< time of the first error since the last calm period
    std::array<char, 128> fault{};    ///< text of the last error
    unsigned calibration = 0;
  };

  static constexpr std::int64_t kCalmNs = static_cast<std::int64_t>(1e9 * kHdCalm);

  explicit HdServo(const HdOptions& options) : api{SharedLibrary(options.library, SharedLibrary::Unload::never)} {}

  /// Starts the frames of `servo`.
  static void schedule(const std::shared_ptr<HdServo>& servo);

  /// Requests a last frame, with zero force, and returns whether it was sent. Waits only briefly, because a servo loop
  /// that stands still sends nothing.
  [[nodiscard]] bool end_frames() noexcept;

  /// Stops the library's servo loop and releases the device and `hd_in_use`. The library may never return.
  void shut_down() noexcept;

  HdApi api;
  HdHandle handle = kHdInvalid;
  int styles = 0;  ///< bits of HdCalibrationStyle
  bool takes_torque = false;
  Mailbox<Order> order;
  Mailbox<Answer> answer;

 private:
  static constexpr int kFramesPerCheck = 100;  ///< frames between two checks of the calibration
  static constexpr std::chrono::milliseconds kCalibratorRest{20};

  // Called in the library's thread.
  static unsigned frame(void* servo) noexcept;
  void frame() noexcept;
  void read(DeviceState& state) noexcept;
  void send(const Wrench& wrench) noexcept;
  void check_calibration() noexcept;

  // Runs in the calibrator's thread.
  void calibrate_when_asked() noexcept;

  HdSchedulerHandle scheduled_ = kHdInvalid;
  std::atomic<bool> ending_{false};
  std::atomic<bool> ended_{false};  ///< zero force was sent, and nothing else will be sent

  // Used in the library's thread.
  Answer next_;
  int until_check_ = 0;

  std::atomic<bool> calibration_due_{false};  ///< set by the library's thread, cleared by the calibrator's
  LooseThread calibrator_;
};

class OpenHapticsDevice final : public Device {
 public:
  explicit OpenHapticsDevice(const HdOptions& options);
  ~OpenHapticsDevice() override { OpenHapticsDevice::close(); }

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override;
  [[nodiscard]] ZeroForce zero_force() noexcept override;
  [[nodiscard]] ZeroForce emergency_stop() noexcept override;
  [[nodiscard]] std::string lost_reason() const override;
  [[nodiscard]] std::string not_ready_reason() const override;

 private:
  static constexpr std::int64_t kLongestFaultNs = static_cast<std::int64_t>(1e9 * kHdLongestFault);
  static constexpr std::int64_t kPatienceNs = static_cast<std::int64_t>(1e9 * kHdPatience);

  void init(const HdOptions& options);
  void describe(const HdOptions& options);
  void start(const HdOptions& options);
  [[nodiscard]] Error refuse(const std::string& what, const std::string& remedy) const;

  const std::shared_ptr<HdServo> servo_;  ///< shared with the library's threads
  HdApi& api_;
  DeviceInfo info_;
  bool closed_ = true;
  bool lost_ = false;
  ZeroForce farewell_ = ZeroForce::confirmed;  ///< result of close(); there is no force before the first frame
  HdServo::Answer newest_;
};

OpenHapticsDevice::OpenHapticsDevice(const HdOptions& options)
    : servo_(std::make_shared<HdServo>(options)), api_(servo_->api) {
  info_.name = options.text;
  info_.backend = kOpenHaptics;
  if (hd_in_use.test_and_set())
    throw device_error(fmt::format(
        "{}: another OpenHaptics device is open in this process, or its library does not return from closing it; close "
        "it first, or restart the program",
        info_.name));
  closed_ = false;
  try {
    init(options);
    describe(options);
    start(options);
  } catch (...) {
    close();
    throw;
  }
}

Error OpenHapticsDevice::refuse(const std::string& what, const std::string& remedy) const {
  return device_error(fmt::format("{}: {}; {}", info_.name, what, remedy));
}

void OpenHapticsDevice::init(const HdOptions& options) {
  // Without a name the library should choose the default device. Some installations only know it by its name, which
  // differs between versions.
  const std::vector<const char*> names = options.name.empty()
                                             ? std::vector<const char*>{nullptr, "Default Device", "Default PHANToM"}
                                             : std::vector<const char*>{options.name.c_str()};
  (void)api_.error();           // clears earlier errors
  const char* error = nullptr;  // error of the first attempt
  for (const char* name : names) {
    servo_->handle = api_.init_device(name);
    const char* refused = api_.error();
    if (refused == nullptr && servo_->handle != kHdInvalid) {
      api_.make_current(servo_->handle);
      return;
    }
    if (error == nullptr) error = refused;
    if (servo_->handle != kHdInvalid) api_.disable_device(std::exchange(servo_->handle, kHdInvalid));
  }
  const std::string who = options.name.empty()
                              ? "the default device (also tried as 'Default Device' and 'Default PHANToM')"
                              : "'" + options.name + "'";
  throw refuse(
      fmt::format("its library was found, but {} cannot be opened: {}", who, error != nullptr ? error : "no handle"),
      "check that it is plugged in, switched on, and set up with the vendor's Touch_Setup under that name, and check "
      "the permissions with haptrace doctor");
}

void OpenHapticsDevice::describe(const HdOptions& options) {
  const auto text = [this](HdEnum what) {
    const char* found = api_.get_string(what);
    return std::string(found != nullptr ? found : "");
  };
  const auto number = [this](HdEnum what) {
    double value = 0;
    api_.get_doubles(what, &value);
    return std::isfinite(value) ? value : 0;
  };
  const auto integer = [this](HdEnum what) {
    int value = 0;
    api_.get_integers(what, &value);
    return value;
  };
  info_.model = text(kHdModel).empty() ? "OpenHaptics device" : text(kHdModel);
  info_.serial = text(kHdSerial);
  info_.measures_velocity = true;
  info_.measures_orientation = true;
  servo_->takes_torque = integer(kHdOutputDof) >= 6;
  info_.torque_axes.fill(servo_->takes_torque);
  info_.max_force = number(kHdMaxForce);
  if (info_.max_force <= 0)
    throw refuse("its library does not report its largest force", "set it up with the vendor's Touch_Setup");
  info_.max_continuous_force = std::min(number(kHdMaxContinuousForce), info_.max_force);
  if (options.rate > 0) info_.nominal_rate = static_cast<double>(options.rate);

  info_.workspace_min = info_.workspace_max = Vec3::Zero();
  for (const HdEnum which : {kHdUsableWorkspace, kHdMaxWorkspace}) {
    double box[6] = {};
    api_.get_doubles(which, box);
    const Vec3 least = kHdLength * Vec3(box), most = kHdLength * Vec3(box + 3);
    if (!is_finite(least) || !is_finite(most) || !(least.array() < most.array()).all()) continue;
    info_.workspace_min = least;
    info_.workspace_max = most;
    break;
  }
  if (info_.workspace_min == info_.workspace_max)
    throw refuse("its library does not report its workspace", "set it up with the vendor's Touch_Setup");

  servo_->styles = integer(kHdCalibrationStyle);
  info_.notes.push_back(fmt::format("driven by {} ({}); haptrace has not been tried with it on a real device yet",
                                    api_.library.file(), text(kHdVersion)));
  info_.notes.push_back(
      fmt::format("its library has its own limits: forces fade in ({:.3g}/s), and it stops beyond {:.3g} m/s or sudden "
                  "changes of {:.3g} N (0: unknown); a stiff playback of a fast path may exceed them",
                  number(kHdRampingRate), kHdLength * number(kHdVelocityLimit), number(kHdImpulseLimit)));
  (void)api_.error();  // clears the errors of queries that this library does not know
}

void OpenHapticsDevice::start(const HdOptions& options) {
  if (options.reset_encoders) api_.update_calibration(kHdEncoderReset);
  if (options.rate > 0) {
    api_.set_scheduler_rate(options.rate);
    if (const char* error = api_.error())
      info_.notes.push_back(
          fmt::format("its library keeps its own rate: {} ({} Hz was requested)", error, options.rate));
  }
  api_.enable(kHdMaxForceClamping);
  api_.enable(kHdForceOutput);
  if (const char* error = api_.error())
    throw refuse(fmt::format("its forces cannot be switched on: {}", error), "check its power");

  HdServo::schedule(servo_);
  if (const char* error = api_.error())
    throw refuse(fmt::format("its servo loop cannot be started: {}", error), "end other programs that use it");

  const std::int64_t begin = monotonic_ns();
  while (newest_.frame_ns == 0) {
    if (monotonic_ns() - begin > 1'000'000'000)
      throw refuse("it was opened, but its servo loop does not run",
                   "end other programs that use it, and plug it in again");
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    newest_ = servo_->answer.latest();
  }
  if (const std::string why = not_ready_reason(); !why.empty()) info_.notes.push_back(why);
}

// ---- in the library's thread ----

void HdServo::schedule(const std::shared_ptr<HdServo>& servo) {
  if ((servo->styles & (kHdInkwell | kHdAuto)) != 0)
    servo->calibrator_ = LooseThread([servo] { servo->calibrate_when_asked(); });
  servo->scheduled_ = servo->api.schedule(&HdServo::frame, servo.get(), kHdHighestPriority);
  servo->api.start_scheduler();
}

unsigned HdServo::frame(void* servo) noexcept {
  static_cast<HdServo*>(servo)->frame();
  return kHdGoOn;
}

void HdServo::frame() noexcept {
  const bool ending = ending_.load(std::memory_order_acquire);
  DeviceState state;

  api.begin_frame(handle);
  const std::int64_t now = monotonic_ns();
  if (until_check_-- <= 0) check_calibration();
  read(state);
  const Order& newest = order.latest();
  const bool calm = next_.fault_ns == 0 || now - next_.fault_ns > kCalmNs;
  const bool may_push = !ending && calm && next_.calibration == kHdCalibrated && now < newest.until_ns;
  send(may_push ? newest.wrench : Wrench{});
  api.end_frame(handle);

  next_.frame_ns = now;
  if (const char* error = api.error()) {
    if (calm) next_.fault_since_ns = now;
    next_.fault_ns = now;
    std::strncpy(next_.fault.data(), error, next_.fault.size() - 1);
  } else {
    if (next_.calibration != kHdCalibrated) state.position = next_.state.position;
    next_.state = state;
    next_.taken_ns = now;
  }
  answer.post(next_);
  if (ending) ended_.store(true, std::memory_order_release);
}

void HdServo::read(DeviceState& state) noexcept {
  double position[3] = {}, velocity[3] = {}, transform[16] = {};
  int buttons = 0;
  api.get_doubles(kHdPosition, position);
  api.get_doubles(kHdVelocity, velocity);
  api.get_doubles(kHdTransform, transform);
  api.get_integers(kHdButtons, &buttons);
  state.position = kHdLength * Vec3(position);
  state.velocity = kHdLength * Vec3(velocity);
  state.orientation = orientation_from_open_haptics(transform);
  state.buttons = static_cast<std::uint32_t>(buttons);
  state.ready = next_.calibration == kHdCalibrated;
}

void HdServo::send(const Wrench& wrench) noexcept {
  api.set_doubles(kHdForce, wrench.force.data());
  if (!takes_torque) return;
  const Vec3 torque = wrench.torque / kHdTorque;
  api.set_doubles(kHdTorqueOut, torque.data());
}

void HdServo::check_calibration() noexcept {
  until_check_ = kFramesPerCheck;
  next_.calibration = api.check_calibration();
  if (next_.calibration == kHdNeedsUpdate) calibration_due_.store(true, std::memory_order_relaxed);
}

// ---- in the calibrator's thread ----

/// Updates the calibration outside the library's servo loop, because the call may take longer than a frame. An
/// automatic calibration happens at once, one in an inkwell once the stylus is there.
void HdServo::calibrate_when_asked() noexcept {
  const HdEnum style = (styles & kHdInkwell) != 0 ? kHdInkwell : kHdAuto;
  while (!ending_.load(std::memory_order_relaxed)) {
    if (calibration_due_.exchange(false, std::memory_order_relaxed)) {
      api.make_current(handle);
      api.update_calibration(style);
      (void)api.error();  // the next check of the calibration shows whether it worked
    }
    std::this_thread::sleep_for(kCalibratorRest);
  }
}

// ---- in the thread that closes the device ----

bool HdServo::end_frames() noexcept {
  ending_.store(true, std::memory_order_release);
  if (scheduled_ == kHdInvalid) return true;  // no frame has sent a force
  for (int k = 0; k < 100 && !ended_.load(std::memory_order_acquire); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return ended_.load(std::memory_order_acquire);
}

void HdServo::shut_down() noexcept {
  (void)calibrator_.join_within(kLongestCalibration);
  if (handle != kHdInvalid) {
    if (scheduled_ != kHdInvalid) {
      api.unschedule(scheduled_);
      api.stop_scheduler();
    }
    api.make_current(handle);
    api.disable(kHdForceOutput);
    api.disable_device(handle);
  }
  hd_in_use.clear();
}

// ---- in the tick's thread ----

Device::Status OpenHapticsDevice::exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept {
  if (closed_ || lost_) return Status::lost;
  servo_->order.post({sendable(wrench), monotonic_ns() + ThreadedDevice::watched_ns(dt)});
  newest_ = servo_->answer.latest();
  const std::int64_t now = monotonic_ns();  // taken after the newest frame, so that its age is not negative
  if (const std::int64_t silence = now - newest_.frame_ns; silence > kPatienceNs) {
    if (silence < kLongestFaultNs) return Status::away;
    lost_ = true;
    return Status::lost;
  }
  if (newest_.fault_ns != 0 && now - newest_.fault_ns <= HdServo::kCalmNs) {
    if (newest_.fault_ns - newest_.fault_since_ns < kLongestFaultNs) return Status::away;
    lost_ = true;
    return Status::lost;
  }
  state = newest_.state;
  state.sequence = static_cast<std::uint64_t>(newest_.taken_ns);
  state.age += 1e-9 * static_cast<double>(now - newest_.taken_ns);
  return Status::ok;
}

ZeroForce OpenHapticsDevice::zero_force() noexcept {
  if (closed_) return farewell_;
  const std::int64_t begin = monotonic_ns();
  for (int k = 0; k < 100; ++k) {
    const HdServo::Answer& answer = servo_->answer.latest();
    if (answer.frame_ns > begin && answer.fault_ns != answer.frame_ns) return ZeroForce::confirmed;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return ZeroForce::failed;
}

ZeroForce OpenHapticsDevice::emergency_stop() noexcept {
  return servo_->end_frames() ? ZeroForce::confirmed : ZeroForce::failed;
}

void OpenHapticsDevice::close() noexcept {
  if (std::exchange(closed_, true)) return;
  farewell_ = servo_->end_frames() ? ZeroForce::confirmed : ZeroForce::failed;
  (void)call_within(kLongestShutDown, [servo = servo_] { servo->shut_down(); });
}

std::string OpenHapticsDevice::lost_reason() const {
  if (closed_ && !lost_) return "the device is closed";
  const bool is_faulty = newest_.fault_ns != 0 && newest_.frame_ns - newest_.fault_ns <= HdServo::kCalmNs;
  if (!is_faulty) return "its library's servo loop has stopped; check its cable and its power";
  return fmt::format("its library reports: {}; hold it, move slowly, use softer gains, and let warm motors cool",
                     newest_.fault.data());
}

std::string OpenHapticsDevice::not_ready_reason() const {
  if (newest_.calibration == kHdCalibrated) return "";
  if ((servo_->styles & kHdInkwell) != 0)
    return "it is not calibrated: put its stylus into the inkwell until it stays ready";
  if ((servo_->styles & kHdEncoderReset) != 0)
    return "it is not calibrated: hold its arm in the reset position that its manual shows, and open it with "
           "openhaptics:reset_encoders=true";
  return "it is not calibrated: move it slowly through its workspace. If it stays uncalibrated, use the vendor's "
         "Touch_Diagnostic";
}

std::unique_ptr<Device> open_open_haptics(const DeviceSpec& spec) {
  HdOptions options{.text = spec.text, .library = open_haptics_library()};
  if (const std::string file = spec.option("library"); !file.empty()) options.library.places = {file};
  options.name = spec.option("name");
  options.rate = spec.number<std::uint64_t>("rate", 100, 10'000, 0, "Hz");
  options.reset_encoders = spec.flag("reset_encoders");
  return std::make_unique<OpenHapticsDevice>(options);
}

}  // namespace

Quat orientation_from_open_haptics(const double (&transform)[16]) {
  const Eigen::Matrix3d r = Eigen::Map<const Eigen::Matrix4d>(transform).topLeftCorner<3, 3>();
  return Quat(r).normalized();
}

WantedLibrary open_haptics_library() {
  std::vector<std::string> folders;
  if (const char* sdk = std::getenv("OH_SDK_BASE")) folders.push_back(fmt::format("{}/lib", sdk));
  if (const char* home = std::getenv("HOME")) folders.push_back(fmt::format("{}/.local/lib", home));
  for (const char* folder : {"/opt/OpenHaptics/Developer/3.4-0/lib", "/usr/local/lib", "/usr/lib64", "/usr/lib"})
    folders.emplace_back(folder);
  WantedLibrary wanted{.what = "OpenHaptics' library libHD",
                       .places = library_files(folders, "libHD.so"),
                       .remedy =
                           "install 3D Systems' OpenHaptics and the Touch Device Driver (support.3dsystems.com), or "
                           "name the file: openhaptics:library=/path/libHD.so"};
  wanted.places.emplace_back("libHD.so");
  return wanted;
}

DeviceBackend open_haptics_backend() {
  return {.name = kOpenHaptics,
          .summary = "Touch and PHANTOM, through 3D Systems' OpenHaptics",
          .options = {{"library", "path of the vendor's libHD.so (default: search the usual folders)"},
                      {"name", "name of the device in the vendor's Touch_Setup (default: the default device)"},
                      {"rate", "rate of the vendor's servo loop (default: the library's own) [Hz]"},
                      {"reset_encoders", "true: its arm is in its reset position now (for models without an inkwell)"}},
          .presets = {},
          .open = open_open_haptics,
          .find = [] { return find_plugged("3D Systems Touch", kOpenHaptics, open_haptics_library()); }};
}

}  // namespace haptrace
