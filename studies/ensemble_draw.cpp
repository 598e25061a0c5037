#include "studies/ensemble_draw.h"

#include "base/enum_names.h"
#include "base/error.h"

#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

HandSpec draw_hand(Lot& lot) {
  HandSpec hand;
  hand.mass = lot.in(ensemble::kHandMass);
  hand.grip_stiffness = lot.in_logarithm(ensemble::kGripStiffness);
  hand.grip_damping = lot.in(ensemble::kGripDamping);
  hand.arm_stiffness = lot.in(ensemble::kArmStiffness);
  hand.arm_relaxation = lot.in(ensemble::kArmRelaxation);
  hand.arm_damping = lot.in(ensemble::kArmDamping);
  hand.tremor = ensemble::kTremor;
  hand.drift = ensemble::kDrift;
  return hand;
}

constexpr EnumNames<EnsembleKind, kEnsembleKinds> kKindNames{
    "kind of device",
    {"small", "late", "delay-2ms", "delay-3ms", "delay-4ms", "inertia-50", "inertia-70", "inertia-50-delay-3ms",
     "cables", "backlash", "link", "saturation", "tremor-0.5N", "tremor-1N", "everything"}};

void vary_inertia(SimSpec& s, double variation) {
  s.inertia_variation = variation;
  s.inertia_length = ensemble::kInertiaLength;
}

void add_cables(SimSpec& s) {
  s.cogging = Vec3::Constant(ensemble::kCable);
  s.cogging_period = ensemble::kCablePeriod;
}

void add_backlash(Lot& lot, SimSpec& s) {
  s.structural_mode = {.frequency_hz = ensemble::kBacklashLinkHz,
                       .damping_ratio = lot.in(ensemble::kLinkDamping),
                       .handle_fraction = lot.in(ensemble::kHandleFraction)};
  s.backlash = ensemble::kBacklash;
}

/// Adds what distinguishes a hard kind to a device that a hand holds.
void harden(EnsembleKind kind, Lot& lot, SimSpec& s) {
  s.delay = lot.in(ensemble::kLateDelay);
  s.actuator_bandwidth_hz = 1 / (2 * std::numbers::pi * ensemble::kLateLag);
  s.hand->drift_hz = ensemble::kHardDriftHz;
  s.hand->tremor_hz = ensemble::kHardTremorHz;
  const auto shake = [&](double tremor) {
    s.hand->tremor = tremor;
    s.hand->tremor_hz = ensemble::kStrongTremorHz;
  };
  switch (kind) {
    case EnsembleKind::small:
    case EnsembleKind::late:
      break;
    case EnsembleKind::delay_2:
      s.delay = 2e-3;
      break;
    case EnsembleKind::delay_3:
      s.delay = 3e-3;
      break;
    case EnsembleKind::delay_4:
      s.delay = 4e-3;
      break;
    case EnsembleKind::inertia_50:
      vary_inertia(s, 0.5);
      break;
    case EnsembleKind::inertia_70:
      vary_inertia(s, 0.7);
      break;
    case EnsembleKind::inertia_50_delay:
      vary_inertia(s, 0.5);
      s.delay = 3e-3;
      break;
    case EnsembleKind::cables:
      add_cables(s);
      break;
    case EnsembleKind::backlash:
      add_backlash(lot, s);
      break;
    case EnsembleKind::link:
      s.structural_mode = {.frequency_hz = lot.in(ensemble::kLinkHz),
                           .damping_ratio = lot.in(ensemble::kLinkDamping),
                           .handle_fraction = lot.in(ensemble::kHandleFraction)};
      break;
    case EnsembleKind::saturation:
      s.motor_limit = lot.in(ensemble::kMotorLimit);
      break;
    case EnsembleKind::tremor_half:
      shake(0.5);
      break;
    case EnsembleKind::tremor_one:
      shake(1);
      break;
    case EnsembleKind::everything:
      vary_inertia(s, 0.5);
      s.delay = 3e-3;
      add_cables(s);
      add_backlash(lot, s);
      break;
  }
}

}  // namespace

const char* to_string(EnsembleKind kind) noexcept {
  return kKindNames.name(kind);
}

EnsembleKind parse_ensemble_kind(const std::string& text) {
  return kKindNames.parse(text);
}

std::vector<std::string> ensemble_kind_names() {
  return kKindNames.list();
}

std::vector<EnsembleKind> hard_kinds() {
  std::vector<EnsembleKind> kinds;
  for (std::size_t kind = static_cast<std::size_t>(EnsembleKind::delay_2); kind < kEnsembleKinds; ++kind) {
    if (kind % 2 == 0) kinds.push_back(EnsembleKind::late);
    kinds.push_back(static_cast<EnsembleKind>(kind));
  }
  return kinds;
}

void check_draws(std::size_t draws) {
  if (draws < 1 || draws > 1'000'000)
    throw input_error(fmt::format("the number of draws is {}; it must be from 1 to 1000000", draws));
}

EnsembleDraw draw_device(std::uint64_t seed, std::uint64_t index, EnsembleKind kind) {
  const bool hard = kind != EnsembleKind::small;
  Lot lot(seed, index);
  EnsembleDraw draw;
  SimSpec& s = draw.spec;
  s.model = hard ? fmt::format("device {} of ensemble {}, {}", index, seed, to_string(kind))
                 : fmt::format("device {} of ensemble {}", index, seed);

  s.rotation = lot.in(ensemble::kRotation)*lot.direction();
  s.mass = lot.by_axis(lot.in(ensemble::kMass));
  s.viscous = lot.by_axis(lot.in(ensemble::kViscous));
  s.coulomb = lot.by_axis(lot.in(ensemble::kCoulomb));
  s.static_ratio = lot.in(ensemble::kStaticRatio);
  s.stribeck_velocity = lot.in(ensemble::kStribeckVelocity);
  s.presliding_stiffness = s.coulomb / lot.in(ensemble::kPreslidingDistance);
  s.cogging = Vec3::Constant(lot.in(ensemble::kCogging));
  s.cogging_period = lot.in(ensemble::kCoggingPeriod);
  s.gravity_bias = lot.in(ensemble::kGravity)*lot.direction();
  for (int axis = 0; axis < 3; ++axis) s.gravity_gradient(axis, axis) = lot.in(ensemble::kGravityGradient);

  s.delay = lot.in(ensemble::kDelay);
  s.actuator_bandwidth_hz = 1 / (2 * std::numbers::pi * lot.in(ensemble::kActuatorLag));
  s.position_resolution = ensemble::kPositionResolution;
  s.force_resolution = ensemble::kForceResolution;
  s.max_force = s.max_continuous_force = ensemble::kMaxForce;  // the loop is judged, not motor heating
  s.workspace = {Vec3::Constant(-ensemble::kReach), Vec3::Constant(ensemble::kReach)};

  draw.noise_seed = lot.seed();
  if (!lot.happens(ensemble::kNobody) || hard) s.hand = draw_hand(lot);
  if (hard) harden(kind, lot, s);
  return draw;
}

}  // namespace haptrace
