#include "player/calibration/first_look.h"

#include <algorithm>
#include <cmath>

namespace haptrace {

FirstLook::FirstLook(const CalibrationPlan& plan) : axes_(plan.axes) {
  for (int axis = 0; axis < 3; ++axis) {
    if (!axes_[static_cast<std::size_t>(axis)]) continue;
    const std::vector<SpectralLine>& lines = plan.dither.lines(axis);
    for (std::size_t i = 0; i < kLines; ++i) {
      const auto nearest = std::min_element(lines.begin(), lines.end(), [&](const auto& a, const auto& b) {
        return std::abs(a.frequency_hz - kWanted[i]) < std::abs(b.frequency_hz - kWanted[i]);
      });
      sums_[static_cast<std::size_t>(axis)][i].w = kTwoPi * nearest->frequency_hz;
    }
  }
}

void FirstLook::reset() noexcept {
  for (auto& axis : sums_)
    for (Sum& sum : axis) sum = Sum{.w = sum.w};
  speed_ = asked_ = along_ = squares_ = Vec3::Zero();
  windows_ = 0;
}

void FirstLook::add(const State& state, double time, double share, const Vec3& speed_asked,
                    const Vec3& excitation) noexcept {
  const double window = 0.5 * (1 - std::cos(kTwoPi * share));
  windows_ += window;
  for (int axis = 0; axis < 3; ++axis) {
    if (!axes_[static_cast<std::size_t>(axis)]) continue;
    for (Sum& sum : sums_[static_cast<std::size_t>(axis)]) {
      const std::complex<double> turn = std::polar(window, -sum.w * time);
      sum.force += turn * std::polar(1.0, sum.w * state.dt) * state.force_applied[axis];
      sum.excitation += turn * excitation[axis];
      for (int i = 0; i < 3; ++i) sum.position[static_cast<std::size_t>(i)] += turn * state.position[i];
    }
    speed_[axis] += std::abs(state.velocity[axis]);
    asked_[axis] += std::abs(speed_asked[axis]);
    along_[axis] += window * state.velocity[axis] * speed_asked[axis];
    squares_[axis] += window * speed_asked[axis] * speed_asked[axis];
  }
}

double FirstLook::mass(int axis) const noexcept {
  std::array<double, kLines> masses{};
  for (std::size_t i = 0; i < kLines; ++i) {
    const Sum& sum = sums_[static_cast<std::size_t>(axis)][i];
    masses[i] =
        std::abs(sum.force) / (sum.w * sum.w * std::max(std::abs(sum.position[static_cast<std::size_t>(axis)]), 1e-9));
  }
  std::sort(masses.begin(), masses.end());
  return masses[kLines / 2];
}

double FirstLook::lag(int axis) const noexcept {
  std::array<double, kLines> lags{};
  for (std::size_t i = 0; i < kLines; ++i) {
    const Sum& sum = sums_[static_cast<std::size_t>(axis)][i];
    lags[i] = -std::arg(-sum.position[static_cast<std::size_t>(axis)] / sum.force) / sum.w;
  }
  std::sort(lags.begin(), lags.end());
  return std::max(lags[kLines / 2], 0.0);
}

bool FirstLook::follows(int axis) const noexcept {
  constexpr double kLongest = 10e-3, kStep = 0.5e-3;  // [s]
  constexpr double kClearly = 1;                      // out of kLines
  const auto& sums = sums_[static_cast<std::size_t>(axis)];
  double with = -kLines, against = -kLines;
  for (double delay = 0; delay <= kLongest; delay += kStep) {
    double along = 0;
    for (const Sum& sum : sums)
      along += std::cos(std::arg(-sum.position[static_cast<std::size_t>(axis)] / sum.force) + sum.w * delay);
    with = std::max(with, along);
    against = std::max(against, -along);
  }
  double straight = 0, across = 0;
  for (const Sum& sum : sums)
    for (int i = 0; i < 3; ++i) {
      const double gain = std::abs(sum.position[static_cast<std::size_t>(i)]) * sum.w * sum.w / std::abs(sum.force);
      if (i == axis)
        straight += gain;
      else
        across = std::max(across, gain);
    }
  return against < with + kClearly && across < straight;
}

bool FirstLook::obeys(int axis) const noexcept {
  constexpr double kLeast = 0.6, kMost = 1.4;
  const double share = squares_[axis] > 0 ? along_[axis] / squares_[axis] : 0;
  return share > kLeast && share < kMost;
}

bool FirstLook::repeats(const FirstLook& other, int axis) const noexcept {
  constexpr double kAlike = 0.25;  // bound on |a - b| / (|a| + |b|); between independent responses its median is 0.7
  std::array<double, kLines> differences{};
  for (std::size_t line = 0; line < kLines; ++line) {
    const Sum &a = sums_[static_cast<std::size_t>(axis)][line], &b = other.sums_[static_cast<std::size_t>(axis)][line];
    double largest = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::complex<double> in_a = a.position[i] / a.excitation, in_b = b.position[i] / b.excitation;
      const double both = std::abs(in_a) + std::abs(in_b);
      if (!(both > largest)) continue;
      largest = both;
      differences[line] = std::abs(in_a - in_b) / both;
    }
  }
  std::sort(differences.begin(), differences.end());
  return differences[kLines / 2] < kAlike;
}

double FirstLook::amplitude(int axis) const noexcept {
  std::array<double, kLines> all{};
  for (std::size_t line = 0; line < kLines; ++line)
    all[line] = 2 * std::abs(sums_[static_cast<std::size_t>(axis)][line].position[static_cast<std::size_t>(axis)]) /
                std::max(windows_, 1.0);
  std::sort(all.begin(), all.end());
  return all[kLines / 2];
}

}  // namespace haptrace
