// Test-retest reliability: how far two sessions of an unchanged person differ.
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace haptrace {

/// Variance components of repeated sessions, one value per person and session (McGraw and Wong 1996, two-way model).
/// SD is that of all values: sqrt(persons + sessions + residual).
struct Reliability {
  double icc_agreement = 0;    ///< ICC(A,1) = ICC(2,1): a shift of all persons between sessions, as practice, counts
  double icc_consistency = 0;  ///< ICC(C,1) = ICC(3,1): such a shift does not count
  double sem = 0;              ///< standard error of measurement, SD sqrt(1 - ICC(A,1)), in the unit of the values
  double mdc95 = 0;            ///< minimal detectable change of a person, see mdc95()
};

/// Returns the reliability of a table with one row per person and one column per session. Returns nothing for fewer
/// than three persons or two sessions, and when all values are equal. Throws Error(input) for rows of different lengths
/// and for values that are not finite.
///
/// Threads: free functions without state.
std::optional<Reliability> reliability(std::span<const std::vector<double>> persons);

/// Returns the standard error of measurement, SD sqrt(1 - ICC). A negative ICC counts as 0.
double standard_error_of_measurement(double sd, double icc);

/// Returns the change between two sessions that an unchanged person exceeds in 5 % of cases: 1.96 sqrt(2 / m) SEM,
/// where each value is the mean of `sessions` = m sessions.
double mdc95(double sem, int sessions = 1);

}  // namespace haptrace
