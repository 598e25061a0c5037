#include "control/design/multisine.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numbers>

namespace haptrace {

Multisine::Multisine(double low_hz, double high_hz, double period, const std::array<bool, 3>& axes) : period_(period) {
  std::vector<std::size_t> driven;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (axes[axis]) driven.push_back(axis);

  const auto first = static_cast<int>(std::ceil(low_hz * period)) | 1;
  for (int multiple = first, dealt = 0; multiple <= high_hz * period && !driven.empty(); ++dealt) {
    lines_[driven[static_cast<std::size_t>(dealt) % driven.size()]].push_back(
        {.frequency_hz = multiple / period, .amplitude = std::sqrt(multiple)});
    multiple += multiple < kDenseBelow * period ? 2 : 4;
  }

  for (const std::size_t axis : driven) {
    std::vector<SpectralLine>& lines = lines_[axis];
    if (lines.size() < 4)
      throw input_error(fmt::format(
          "the band from {} to {} Hz has only {} lines for an axis with a period of {} s; an axis needs four", low_hz,
          high_hz, lines.size(), period));
    double power = 0;
    for (const SpectralLine& line : lines) power += line.amplitude * line.amplitude;
    // Schroeder: the phase changes from line to line by 2 pi times the fraction of the power up to that line.
    double below = 0, phase = 0;
    for (SpectralLine& line : lines) {
      line.phase = -phase;
      line.amplitude *= std::sqrt(2 / power);
      below += 0.5 * line.amplitude * line.amplitude;
      phase += 2 * std::numbers::pi * below;
    }
  }
}

Vec3 Multisine::value(double time) const noexcept {
  Vec3 force = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis)
    for (const SpectralLine& line : lines_[static_cast<std::size_t>(axis)])
      force[axis] += line.amplitude * std::cos(2 * std::numbers::pi * line.frequency_hz * time + line.phase);
  return force;
}

std::vector<double> Multisine::frequencies() const {
  std::vector<double> result;
  for (const auto& lines : lines_)
    for (const SpectralLine& line : lines) result.push_back(line.frequency_hz);
  std::sort(result.begin(), result.end());
  return result;
}

}  // namespace haptrace
