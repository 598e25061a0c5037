#include "metrics/reliability.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

void require_table(std::span<const std::vector<double>> persons) {
  for (std::size_t i = 0; i < persons.size(); ++i) {
    if (persons[i].size() != persons.front().size())
      throw input_error(
          fmt::format("person {} of the retest data has {} sessions and the first has {}; every person "
                      "needs the same number",
                      i + 1, persons[i].size(), persons.front().size()));
    for (const double value : persons[i])
      if (!std::isfinite(value))
        throw input_error(fmt::format("person {} of the retest data has a value that is not finite", i + 1));
  }
}

}  // namespace

std::optional<Reliability> reliability(std::span<const std::vector<double>> persons) {
  constexpr std::size_t kFewestPersons = 3, kFewestSessions = 2;
  require_table(persons);
  if (persons.size() < kFewestPersons || persons.front().size() < kFewestSessions) return std::nullopt;
  const std::size_t columns = persons.front().size();
  const auto n = static_cast<double>(persons.size()), k = static_cast<double>(columns);
  double grand = 0;
  std::vector<double> row(persons.size(), 0), column(columns, 0);
  for (std::size_t i = 0; i < persons.size(); ++i)
    for (std::size_t j = 0; j < columns; ++j) {
      grand += persons[i][j] / (n * k);
      row[i] += persons[i][j] / k;
      column[j] += persons[i][j] / n;
    }
  double rows = 0, shifts = 0, residual = 0;  // mean squares
  for (const double mean : row) rows += k * (mean - grand) * (mean - grand) / (n - 1);
  for (const double mean : column) shifts += n * (mean - grand) * (mean - grand) / (k - 1);
  for (std::size_t i = 0; i < persons.size(); ++i)
    for (std::size_t j = 0; j < columns; ++j)
      residual += std::pow(persons[i][j] - row[i] - column[j] + grand, 2) / ((n - 1) * (k - 1));
  const double agreement = rows + (k - 1) * residual + k / n * (shifts - residual);
  const double consistency = rows + (k - 1) * residual;
  constexpr double kRounding = 1e-24;
  if (!(std::min(agreement, consistency) > kRounding * grand * grand)) return std::nullopt;
  Reliability result{.icc_agreement = (rows - residual) / agreement,
                     .icc_consistency = (rows - residual) / consistency};
  // agreement / k is the sum of the three components, and this is the sum without that of the persons.
  result.sem = std::sqrt(std::max(0.0, (shifts - residual) / n) + residual);
  result.mdc95 = haptrace::mdc95(result.sem);
  return result;
}

double standard_error_of_measurement(double sd, double icc) {
  return sd * std::sqrt(1 - std::clamp(icc, 0.0, 1.0));
}

double mdc95(double sem, int sessions) {
  constexpr double kTwoSided = 1.959963984540054;  // normal quantile at 0.975
  return kTwoSided * std::sqrt(2.0 / sessions) * sem;
}

}  // namespace haptrace
