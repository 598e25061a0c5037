// The simulated device: an unknown mechanism in virtual time, held by a simulated hand.
#pragma once

#include "base/nano_time.h"
#include "control/path/orientation_trajectory.h"
#include "control/path/trajectory.h"
#include "devices/device_spec.h"
#include "devices/registry.h"
#include "devices/sim/delay_line.h"
#include "devices/sim/noise.h"
#include "devices/sim/plant.h"
#include "devices/sim/spec.h"
#include "devices/sim/steered_hand.h"
#include "devices/sim/wrist.h"

namespace haptrace {

/// Value of the option `intent` of a hand that a person steers (HandSteering).
inline constexpr const char* kIntentOfView = "view";

struct SimOptions {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  std::string name = "sim";
  std::string serial;  ///< distinguishes devices of one model
  std::uint64_t seed = 1;
  /// The path that the hand follows from the first exchange on, inside the workspace. Without a path or without a hand,
  /// there is no intent.
  std::optional<Trajectory> intent;
  OrientationTrajectory intent_orientation;  ///< intended orientation of the tool; empty: the identity
  /// Intentions that the hand follows instead of a path; borrowed, null: none. The device then lives in real time.
  HandSteering* steering = nullptr;
  std::int64_t (*clock)() noexcept = nullptr;  ///< of the intentions [ns]; null: CLOCK_MONOTONIC
  std::vector<std::string> notes;              ///< for DeviceInfo::notes
  double lost_at = kNever;                     ///< time at which the cable slips out [s]
  double lost_for = kNever;     ///< time until the cable is back [s]; kNever: the device is lost for good
  double lets_go_at = kNever;   ///< time at which the hand lets go [s]
  double longest_step = 50e-6;  ///< longest step of integration [s]; change it only for studies of the integration
  Integrator integrator = Integrator::semi_implicit;  ///< change it only for such studies, see Plant
};

/// A device that advances only by the dt of exchange. Equal specs, seeds and commands give bit-identical runs. A force
/// that is not finite counts as zero. The device starts at rest at the start of the hand's intent, or at the origin.
/// While its cable is out, the device is away and continues without force, because the hand does not wait.
class SimDevice final : public Device {
 public:
  explicit SimDevice(const SimSpec& spec, const SimOptions& options = {});

  [[nodiscard]] const DeviceInfo& info() const noexcept override { return info_; }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override;
  void close() noexcept override { closed_ = true; }
  [[nodiscard]] ZeroForce zero_force() noexcept override { return ZeroForce::confirmed; }
  [[nodiscard]] ZeroForce emergency_stop() noexcept override { return ZeroForce::confirmed; }
  [[nodiscard]] std::string lost_reason() const override {
    return closed_ ? "the simulated device is closed" : "its simulated cable was unplugged (lost_at)";
  }

  /// Returns the true position and velocity of the handle, which no controller can measure [m, m/s in W].
  [[nodiscard]] Vec3 true_position() const noexcept { return to_world(plant_.handle_position()); }
  [[nodiscard]] Vec3 true_velocity() const noexcept { return to_world(plant_.handle_velocity()); }
  [[nodiscard]] const Plant& plant() const noexcept { return plant_; }
  [[nodiscard]] const Wrist* wrist() const noexcept { return wrist_ ? &wrist_->body : nullptr; }

 private:
  [[nodiscard]] Vec3 to_world(const Vec3& p) const noexcept { return plant_.rotation().transpose() * p; }
  [[nodiscard]] bool cable_is_out() const noexcept;
  [[nodiscard]] Vec3 motor_command(const Wrench& wrench) const noexcept;
  void advance(std::int64_t now, std::int64_t end) noexcept;
  void plan_hand() noexcept;
  void follow_person() noexcept;
  void measure(DeviceState& state) noexcept;
  [[nodiscard]] Vec3 wrist_command(const Wrench& wrench) const noexcept;
  void turn(std::int64_t now, double span) noexcept;

  DeviceInfo info_;
  bool closed_ = false;
  double lost_from_, lost_until_;                           ///< the cable is out between these times [s]
  std::int64_t lets_go_;                                    ///< [ns]
  double strongest_;                                        ///< largest magnitude of the motors' force [N]
  double force_resolution_, position_noise_, force_noise_;  ///< [N], [m], [N]
  Vec3 force_axes_ = Vec3::Zero();                          ///< 1 on axes that take a force, in W

  NanoTime time_;
  DelayLine delay_line_;
  Plant plant_;
  PlantInput input_;
  Gaussian sensor_noise_, hand_noise_;

  /// The wrist, in devices that have one.
  struct TurningHandle {
    Wrist body;
    DelayLine torque;
    double max_torque, resolution;  ///< [N m], [rad]
    OrientationTrajectory intent;
    Trajectory::Cursor intent_cursor;
    Quat intended = Quat::Identity();
  };
  std::optional<TurningHandle> wrist_;

  // The hand's own force and intent are planned every millisecond and interpolated linearly in between.
  bool hand_acts_ = false;
  Vec3 next_hand_force_ = Vec3::Zero(), next_intent_ = Vec3::Zero();
  ColouredNoise tremor_, drift_;
  Trajectory intent_;
  Trajectory::Cursor intent_cursor_;
  std::int64_t hand_tick_ = 0;  ///< time of the next plan [ns]
  HandSteering* steering_;
  std::int64_t (*clock_)() noexcept;
  std::int64_t clock_ns_ = 0;  ///< at this exchange
  SteeredHand steered_;        ///< in actuator axes
};

/// The spec and options that `sim` reads from a device's options.
struct SimParts {
  SimSpec spec;
  SimOptions options;
};
SimParts read_sim_device(const DeviceSpec& device);

/// Opens the simulated device for these options, also as the plant of an emulated device. Throws Error(input).
std::unique_ptr<SimDevice> open_sim_device(const DeviceSpec& device);

/// Returns the backend `sim`.
DeviceBackend sim_backend();

/// Reads the path that the option `intent` names. Throws Error(input).
using SimPathReader = Path (*)(const std::string& file);

/// Sets the reader of paths; without it, `intent` is rejected. Call before the first device is opened; not thread-safe.
void set_sim_path_reader(SimPathReader reader) noexcept;

}  // namespace haptrace
