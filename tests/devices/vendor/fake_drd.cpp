// A fake of Force Dimension's library: its C interface in front of a simulated device.
#include "devices/loop/clock.h"
#include "devices/sim/live_plant.h"
#include "tests/devices/vendor/fake_libraries.h"

#include <cmath>
#include <memory>
#include <mutex>

namespace {

using haptrace::LivePlant;
using haptrace::Vec3;
using haptrace::test::FakeDrd;

FakeDrd fake;
std::mutex plant_use;
std::unique_ptr<LivePlant> plant;  // created when the device opens

bool is_sigma() {
  return fake.type == 104;
}

int open_any() {
  if (!fake.opens) return -1;
  const std::scoped_lock lock(plant_use);
  plant = std::make_unique<LivePlant>(
      haptrace::open_live_plant(haptrace::DeviceSpec{.text = "fake", .name = "fake", .options = {}}, "omega3"));
  fake.braked = true;
  ++fake.opened;
  return 0;
}

int close_any() {
  fake.enabled = false;
  ++fake.closed;
  return 0;
}

int set(double fx, double fy, double fz, double tx, double ty, double tz) {
  if (fake.answer < 0) return -1;
  const double force[] = {fx, fy, fz}, torque[] = {tx, ty, tz};
  for (std::size_t i = 0; i < 3; ++i) {
    fake.force[i] = force[i];
    fake.torque[i] = torque[i];
  }
  fake.braked = false;
  return fake.answer;
}

int get_position(double* x, double* y, double* z) {
  const int answer = fake.position_answer != 0 ? fake.position_answer : fake.answer;
  if (answer < 0) {
    if (fake.pushes()) ++fake.blind_pushes;
    return answer;
  }
  const std::scoped_lock lock(plant_use);
  plant->advance_to(haptrace::monotonic_ns());
  plant->apply({fake.motor(0), fake.motor(1), fake.motor(2)});
  constexpr double kCount = 1e-5;  // encoder resolution [m]
  const Vec3 counted = kCount * (plant->position() / kCount).array().round();
  const Vec3 p = fake.is_placed ? Vec3(fake.place[0], fake.place[1], fake.place[2]) : counted;
  *x = p.x();
  *y = p.y();
  *z = p.z();
  return answer;
}

}  // namespace

extern "C" {

FakeDrd* fake_drd() {
  return &fake;
}

void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  *major = 3;
  *minor = 17;
  *release = 5;
  *revision = 0;
}
const char* dhdErrorGetLastStr() {
  return "the fake's own trouble";
}
int dhdGetDeviceCount() {
  return fake.devices;
}
int dhdOpenID(char) {
  return open_any();
}
int dhdOpenSerial(int serial) {
  return serial == fake.serial ? open_any() : -1;
}
int dhdClose(char) {
  return close_any();
}
int dhdStop(char) {
  fake.braked = true;
  return fake.answer;
}
int dhdGetSystemType(char) {
  return fake.type;
}
const char* dhdGetSystemName(char) {
  return is_sigma() ? "sigma.7" : "omega.3";
}
int dhdGetSerialNumber(unsigned short* serial, char) {
  *serial = static_cast<unsigned short>(fake.serial);
  return 0;
}
int dhdGetStatus(int* status, char) {
  for (int i = 0; i < 17; ++i) status[i] = 0;
  status[3] = fake.calibrated ? 0 : 1;
  status[5] = fake.enabled && fake.force_off_cause == 0 ? 1 : 0;
  status[14] = fake.force_off_cause;
  return fake.answer;
}
int dhdEnableForce(unsigned char on, char) {
  if (fake.answer < 0) return -1;
  fake.enabled = on != 0;
  return fake.answer;
}
int dhdGetPosition(double* x, double* y, double* z, char) {
  return get_position(x, y, z);
}
int dhdGetPositionAndOrientationFrame(double* x, double* y, double* z, double rotation[3][3], char) {
  const double c = std::cos(fake.yaw), s = std::sin(fake.yaw);
  const double turned[3][3] = {{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) rotation[i][j] = turned[i][j];
  return get_position(x, y, z);
}
int dhdSetForce(double fx, double fy, double fz, char) {
  return set(fx, fy, fz, 0, 0, 0);
}
int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty, double tz, double,
                                        char) {
  return set(fx, fy, fz, tx, ty, tz);
}
unsigned dhdGetButtonMask(char) {
  return fake.buttons;
}
int dhdSetGravityCompensation(int on, char) {
  fake.gravity_compensation = on;
  return 0;
}
double dhdGetMaxForce(char) {
  return fake.software_max_force;
}
bool dhdHasWrist(char) {
  return is_sigma();
}
bool dhdHasActiveWrist(char) {
  return is_sigma();
}
bool dhdHasGripper(char) {
  return is_sigma();
}
int dhdEmulateButton(unsigned char on, char) {
  fake.emulated_button = on;
  return 0;
}
int dhdEnableExpertMode() {
  return 0;
}
int dhdSetWatchdog(unsigned char duration, char) {
  if (!fake.has_watchdog) return -1;
  fake.watchdog = duration;
  return 0;
}
int drdOpenID(char) {
  if (!fake.opens_robotic) return -1;
  const int id = open_any();
  if (id >= 0) ++fake.opened_robotic;
  return id;
}
int drdClose(char) {
  return close_any();
}
bool drdIsInitialized(char) {
  return fake.calibrated;
}
int drdAutoInit(char) {
  ++fake.auto_inits;
  if (!fake.auto_init_works) return -1;
  fake.calibrated = true;
  return 0;
}
int drdStop(bool, char) {
  ++fake.robotic_stops;
  return 0;
}

}  // extern "C"
