#include "control/design/identified_device.h"

#include "base/enum_names.h"
#include "base/error.h"
#include "control/design/tracking_design.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {
namespace {

constexpr EnumNames<HandKnown, 3> kHandKnown{"knowledge of the hand", {"identified", "nobody", "assumed"}};
constexpr double kClear = 10;      // evidence from which the choice of a model is clear
constexpr double kLightest = 0.5;  // mass for which laws are designed, over that at the centre: at least

/// Returns the largest ripple of a law, rms per axis [N].
double most_ripple(double max_force) {
  return kMostLawRipple * max_force / std::numbers::sqrt3;
}

LqgDesign design_of(const std::array<std::optional<LqgResult>, 3>& results) {
  LqgDesign design;
  double error = 0, ripple = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!results[axis]) continue;
    const LqgResult& result = *results[axis];
    design.numbers[axis] = result.numbers;
    error += result.figures.error * result.figures.error;
    ripple += result.figures.ripple * result.figures.ripple;
    for (const std::string& unmet : result.unmet) design.unmet.push_back(fmt::format("in {}, {}", "xyz"[axis], unmet));
  }
  design.figures = {.error = std::sqrt(error), .ripple = std::sqrt(ripple)};
  return design;
}

std::array<std::optional<AxisModel>, 3> models_of(const HeldDevice& device, double rate_hz) {
  HeldModel model = device.model;
  model.mass = model.mass.cwiseProduct(device.designed_for);
  return axis_models(model, device.position_noise, rate_hz);
}

}  // namespace

const char* to_string(HandKnown known) noexcept {
  return kHandKnown.name(known);
}

HandKnown parse_hand_known(std::string_view name) {
  return kHandKnown.parse(name);
}

HeldDevice held_device(const Identification& identified, const HeldIdentification& held, double rate_hz,
                       double max_force) {
  HeldDevice device{.margin = held.margin, .position_noise = measured_noise(identified.plant)};
  const auto axes = static_cast<double>(std::max<Eigen::Index>((identified.plant.mass.array() > 0).count(), 1));
  const double most = most_ripple(max_force), fine = std::min(kFineRipple / std::sqrt(axes), most);
  device.ripple = std::clamp(device.position_noise * plain_ripple(rate_hz), fine, most);
  if (held.held.held()) {
    device.model = held.held;
    device.half_width = held.half_width;
    device.hand = HandKnown::identified;
  } else if (held.margin > kClear) {
    device.model = held_model(identified.plant, kHardlyAHand);
    device.hand = HandKnown::nobody;
  } else {
    device.model = held_model(identified.plant, kRelaxedHand);
  }
  return device;
}

void expect_tremor(const HandNoiseIdentification& found, double max_force, HeldDevice& device) {
  device.model.noise = found.noise;
  device.half_width.noise = found.half_width;
  const Vec3 ripple = tremor_at_motors(device.model).ripple;
  const auto axes = static_cast<double>((device.model.mass.array() > 0).count());
  const double most = most_ripple(max_force);
  if (axes > 0) device.ripple = std::min(std::hypot(device.ripple, ripple.norm() / std::sqrt(axes)), most);
}

double answer_to_tremor(const HeldModel& held) noexcept {
  return kMostAnswer * tremor_at_motors(held).whole.maxCoeff();
}

std::pair<Vec3, Vec3> HeldDevice::mass_range() const noexcept {
  const auto [least, most] = inertia ? inertia->range() : std::pair<Vec3, Vec3>{Vec3::Ones(), Vec3::Ones()};
  return {least.cwiseQuotient(designed_for), most.cwiseQuotient(designed_for)};
}

bool design_laws(HeldDevice& device, double rate_hz, const StopRequest& stop,
                 const std::function<void(double)>& progress) {
  LqgSearchOptions options{.plain_ripple = device.ripple};
  if (device.inertia) device.designed_for = device.inertia->typical().cwiseMax(kLightest);
  const auto [least, most] = device.mass_range();
  options.least = least.minCoeff();
  options.most = most.maxCoeff();
  const auto axes = models_of(device, rate_hz);
  // The first search takes half of the time, since nothing is known.
  constexpr std::array kOrder{Firmness::normal, Firmness::quiet, Firmness::exact};
  constexpr std::array<double, kOrder.size() + 1> kDone{0, 0.5, 0.75, 1};
  // An assumed hand may be the wrong one, and a device in another hand moves like another mass.
  if (device.one_mass || device.hand == HandKnown::assumed) {
    options.lighter = 0.7;
    options.heavier = 1.3;
  }
  for (std::size_t i = 0; i < kOrder.size(); ++i) {
    options.firmness = kOrder[i];
    const auto found = search_lqg(axes, options, stop, [&](double done) {
      if (progress) progress(kDone[i] + done * (kDone[i + 1] - kDone[i]));
    });
    if (!found) return false;
    device.design(kOrder[i]) = design_of(*found);
    for (const auto& result : *found)
      if (result && !options.like) options.like = result->numbers;
  }
  return true;
}

std::array<std::optional<LqgLaws>, 3> lqg_laws(const HeldDevice& device, Firmness firmness, double rate_hz) {
  const auto axes = models_of(device, rate_hz);
  std::array<std::optional<LqgLaws>, 3> laws;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto& numbers = device.design(firmness).numbers[axis];
    if (!axes[axis] || !numbers) continue;
    laws[axis] = lqg_laws(*axes[axis], *numbers, device.ripple);
    if (!laws[axis])
      throw input_error(fmt::format(
          "the LQG law of firmness {} does not exist for the model in {}: calibrate again (haptrace calibrate)",
          to_string(firmness), "xyz"[axis]));
  }
  return laws;
}

}  // namespace haptrace
