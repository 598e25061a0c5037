// A fake of OpenHaptics' HD API: its C interface and its servo thread in front of a simulated device.
#include "devices/loop/clock.h"
#include "devices/loop/realtime.h"
#include "devices/loop/servo_session.h"
#include "devices/sim/live_plant.h"
#include "tests/devices/vendor/fake_libraries.h"

#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <thread>

namespace {

using haptrace::LivePlant;
using haptrace::Vec3;
using haptrace::test::AtomicVector;
using haptrace::test::FakeHd;

constexpr unsigned kHandle = 7, kNoHandle = 0xffffffff;
constexpr unsigned long kScheduled = 3;
constexpr unsigned kBadValue = 1, kOutOfFrame = 2, kNoDevice = 3;

FakeHd fake;
std::unique_ptr<LivePlant> plant;  // owned by the servo thread while it runs
std::thread servo;
thread_local bool serves = false;  // true in the servo thread
std::mutex schedule;               // guards the two variables below
unsigned (*callback)(void*) = nullptr;
void* callback_data = nullptr;

thread_local unsigned error = 0;
thread_local bool in_frame = false;
thread_local Vec3 next_force = Vec3::Zero(), next_torque = Vec3::Zero();  // take effect at the end of the frame

void put(AtomicVector& to, const Vec3& from) {
  for (std::size_t i = 0; i < 3; ++i) to[i] = from[static_cast<Eigen::Index>(i)];
}

void rest() {
  put(fake.force, Vec3::Zero());
  put(fake.torque, Vec3::Zero());
}

void serve() {
  (void)haptrace::request_realtime();
  auto next = std::chrono::steady_clock::now();
  while (fake.running) {
    {
      const std::scoped_lock lock(schedule);
      if (callback != nullptr && !fake.frozen && callback(callback_data) == 0) callback = nullptr;
    }
    next = std::max(next + std::chrono::milliseconds(1), std::chrono::steady_clock::now());
    std::this_thread::sleep_until(next);
  }
}

bool belongs_here() {
  if (in_frame) return true;
  ++fake.misused;
  error = kOutOfFrame;
  return false;
}

void may_hang(FakeHd::Call call) {
  if (fake.hangs_in != call) return;
  fake.hung = call;
  while (fake.hangs_in == call) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

void copy(const Vec3& from, double* to) {
  for (Eigen::Index i = 0; i < 3; ++i) to[i] = from[i];
}

}  // namespace

extern "C" {

struct HdErrorInfo {
  unsigned code;
  int internal;
  unsigned device;
};

FakeHd* fake_hd() {
  return &fake;
}

unsigned hdInitDevice(const char* name) {
  const char* expected = fake.default_name;
  const bool is_default = name == nullptr || expected == nullptr ? name == expected : std::string(name) == expected;
  if (!fake.is_there || (!is_default && std::string(name == nullptr ? "" : name) != "Left Device")) {
    error = kNoDevice;
    return kNoHandle;
  }
  plant = std::make_unique<LivePlant>(
      haptrace::open_live_plant(haptrace::DeviceSpec{.text = "fake", .name = "fake", .options = {}}, "touch"));
  ++fake.opened;
  return kHandle;
}
void hdDisableDevice(unsigned) {
  may_hang(FakeHd::Call::disable_device);
  rest();
  ++fake.closed;
}
void hdMakeCurrentDevice(unsigned) {}
void hdBeginFrame(unsigned) {
  in_frame = true;
  ++fake.frames;
  plant->apply(Vec3(fake.force[0], fake.force[1], fake.force[2]));
  plant->advance_to(haptrace::monotonic_ns());
}
void hdEndFrame(unsigned) {
  in_frame = false;
  put(fake.force, fake.output ? next_force : Vec3::Zero());
  put(fake.torque, fake.output ? next_torque : Vec3::Zero());
  if (fake.fault != 0) error = fake.fault;
}
HdErrorInfo hdGetError() {
  const HdErrorInfo info{error, 0, kHandle};
  error = 0;
  return info;
}
const char* hdGetErrorString(unsigned code) {
  return code == kNoDevice     ? "the fake's device is missing"
         : code == kOutOfFrame ? "the fake was called outside of a frame"
         : code == kBadValue   ? "the fake does not take this value"
                               : "the fake's motors are too warm";
}
const char* hdGetString(unsigned what) {
  return what == 0x2501 ? "Touch" : what == 0x2504 ? "A5" : "3.4";
}
void hdGetIntegerv(unsigned what, int* value) {
  if (what == 0x2000 && belongs_here()) *value = fake.buttons;
  if (what == 0x2554) *value = fake.output_dof;
  if (what == 0x2555) *value = fake.styles;
}
void hdGetDoublev(unsigned what, double* value) {
  switch (what) {
    case 0x2050:
      if (belongs_here())
        copy(fake.is_placed ? Vec3(fake.place[0], fake.place[1], fake.place[2]) : 1e3 * plant->position(), value);
      return;
    case 0x2051:
      if (belongs_here()) copy(1e3 * plant->velocity(), value);
      return;
    case 0x2052: {
      if (!belongs_here()) return;
      const double c = std::cos(fake.yaw), s = std::sin(fake.yaw);
      const double columns[16] = {c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 10, 20, 30, 1};
      for (int i = 0; i < 16; ++i) value[i] = columns[i];
      return;
    }
    case 0x2551: {
      const double box[] = {-80, -60, -35, 80, 60, 35};
      for (int i = 0; i < 6; ++i) value[i] = box[i];
      return;
    }
    case 0x2603:
      *value = 3.3;
      return;
    case 0x2604:
      *value = 0.88;
      return;
    case 0x2606:
      *value = 1200;
      return;
    case 0x2607:
      *value = 4;
      return;
    default:
      error = kBadValue;
  }
}
void hdSetDoublev(unsigned what, const double* value) {
  if (!belongs_here()) return;
  (what == 0x2700 ? next_force : next_torque) = Vec3(value);
}
void hdEnable(unsigned what) {
  if (what == 0x4000) fake.output = true;
}
void hdDisable(unsigned what) {
  if (what == 0x4000) fake.output = false;
  rest();
}
unsigned hdCheckCalibration() {
  return fake.calibration;
}
void hdUpdateCalibration(unsigned style) {
  may_hang(FakeHd::Call::update_calibration);
  if (serves) ++fake.misused;
  ++fake.updates;
  fake.updated_style = static_cast<int>(style);
  fake.calibration = FakeHd::kCalibrated;
}
void hdStartScheduler() {
  if (fake.running.exchange(true)) return;
  servo = std::thread([] {
    serves = true;
    serve();
  });
}
void hdStopScheduler() {
  may_hang(FakeHd::Call::stop_scheduler);
  if (!fake.running.exchange(false)) return;
  servo.join();
  rest();
}
void hdSetSchedulerRate(unsigned long) {
  if (!fake.takes_rate) error = kBadValue;
}
unsigned long hdScheduleAsynchronous(unsigned (*function)(void*), void* data, unsigned short) {
  const std::scoped_lock lock(schedule);
  callback = function;
  callback_data = data;
  fake.scheduled = true;
  return kScheduled;
}
void hdUnschedule(unsigned long) {
  may_hang(FakeHd::Call::unschedule);
  const std::scoped_lock lock(schedule);
  callback = nullptr;
  fake.scheduled = false;
}

}  // extern "C"
