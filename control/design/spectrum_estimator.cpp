#include "control/design/spectrum_estimator.h"

#include "control/design/dense.h"

#include <cmath>
#include <complex>
#include <utility>

namespace haptrace {
namespace {

using Complex = std::complex<double>;
using Eigen::MatrixXd;

constexpr int kTrend = 4;           // number of powers of time that model the trend
constexpr double kCoverage = 0.95;  // required fraction of samples in a window

}  // namespace

SpectrumEstimator::SpectrumEstimator(std::vector<double> frequencies, double period, double rate_hz, double movement_hz)
    : frequencies_(std::move(frequencies)), period_(period), rate_hz_(rate_hz), movement_hz_(movement_hz) {}

void SpectrumEstimator::add(std::span<const TickRow> rows) {
  for (std::size_t begin = 0; begin < rows.size();) {
    std::size_t end = begin;
    while (end < rows.size() && rows[end].time < rows[begin].time + period_ - 0.25 / rate_hz_) ++end;
    add_window(rows.subspan(begin, end - begin));
    begin = end;
  }
}

void SpectrumEstimator::add_window(std::span<const TickRow> rows) {
  if (static_cast<double>(rows.size()) < kCoverage * period_ * rate_hz_) return;
  const auto harmonics = static_cast<int>(movement_hz_ * period_ / 2);
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto lines = static_cast<Eigen::Index>(frequencies_.size());
  const Eigen::Index first_line = kTrend + 2 * harmonics;
  MatrixXd basis(n, first_line + 2 * lines);
  MatrixXd data(n, 6);
  const auto put = [&](Eigen::Index row, Eigen::Index column, double angle) {
    basis(row, column) = std::cos(angle);
    basis(row, column + 1) = std::sin(angle);
  };
  for (Eigen::Index k = 0; k < n; ++k) {
    const TickRow& row = rows[static_cast<std::size_t>(k)];
    const double s = 2 * (row.time - rows.front().time) / period_ - 1;
    for (int power = 0; power < kTrend; ++power) basis(k, power) = std::pow(s, power);
    for (int h = 0; h < harmonics; ++h) put(k, kTrend + 2 * h, kTwoPi * 2 * (h + 1) / period_ * row.time);
    for (Eigen::Index i = 0; i < lines; ++i)
      put(k, first_line + 2 * i, kTwoPi * frequencies_[static_cast<std::size_t>(i)] * row.time);
    for (int axis = 0; axis < 3; ++axis) {
      data(k, axis) = row.position[axis] - rows.front().position[axis];
      data(k, axis + 3) = row.force[axis];
    }
  }
  const MatrixXd amplitudes = solve_symmetric(transposed_product(basis, basis), transposed_product(basis, data));
  std::vector<LineResponse>& window = windows_.emplace_back(frequencies_.size());
  for (Eigen::Index i = 0; i < lines; ++i) {
    LineResponse& line = window[static_cast<std::size_t>(i)];
    line.w = kTwoPi * frequencies_[static_cast<std::size_t>(i)];
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      // A cos + B sin is the real part of (A - jB) e^{jwt}.
      const Eigen::Index c = first_line + 2 * i;
      line.position[axis] = Complex(amplitudes(c, axis), -amplitudes(c + 1, axis));
      line.force[axis] = Complex(amplitudes(c, axis + 3), -amplitudes(c + 1, axis + 3));
    }
  }
  residual_ += (data - product(basis, amplitudes)).leftCols(3).squaredNorm();
  samples_ += static_cast<double>(n);
}

LineSpectrum SpectrumEstimator::mean() const {
  LineSpectrum result;
  if (windows_.empty()) return result;
  result.lines = windows_.front();
  for (std::size_t i = 0; i < result.lines.size(); ++i) {
    LineResponse& line = result.lines[i];
    for (std::size_t window = 1; window < windows_.size(); ++window) {
      line.position += windows_[window][i].position;
      line.force += windows_[window][i].force;
    }
    line.position /= static_cast<double>(windows_.size());
    line.force /= static_cast<double>(windows_.size());
  }
  result.noise = std::sqrt(2 * residual_ / (3 * samples_) / samples_);
  return result;
}

}  // namespace haptrace
