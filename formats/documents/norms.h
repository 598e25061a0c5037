// Published values of a metric, and its test-retest error, for reports.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// Norms of one metric, in SI. The file states its error in exactly one way, or not at all.
struct MetricNorm {
  std::optional<double> mdc95;              ///< minimal detectable change, given as such
  std::optional<double> sem;                ///< standard error of measurement
  std::optional<double> sd, icc;            ///< standard deviation over persons, and ICC(A,1)
  std::vector<std::vector<double>> retest;  ///< values by person and session
  std::optional<double> low, high;          ///< reference range

  bool operator==(const MetricNorm&) const = default;
};

/// Norms hold for one device, task and mode. A value is that of a session: the median of its repetitions.
struct Norms {
  std::string file;
  std::string source;                         ///< publication, or the laboratory and its data
  std::string population;                     ///< in words; may be empty
  double age_from = 0, age_to = 0;            ///< [years]
  std::string device;                         ///< part of the device's model or name
  std::string task;                           ///< part of the exercise's name or path
  std::string mode;                           ///< mode of the exercise
  std::map<std::string, MetricNorm> metrics;  ///< by the name of a metric, as contour_rms_m
};

/// Reads a file of norms (docs/report.md describes it). Throws Error(input) naming the file and the key if a key is
/// unknown, missing, of the wrong type or out of range. Does not know the names of metrics.
Norms load_norms(const std::string& file);

}  // namespace haptrace
