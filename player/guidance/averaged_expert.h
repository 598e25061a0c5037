// Average of several experts: one path with its spread, to guide with, to play, and to compare with.
#pragma once

#include "formats/path/path_source.h"
#include "metrics/path_average.h"

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace haptrace {

/// The average of several recordings of one task.
struct AveragedExpert {
  AveragedPath average;
  std::vector<std::string> copies;  ///< names of the recordings
  Path path;                        ///< at 1 kHz, without pauses; with forces if all recordings have them
  std::vector<double> radius;       ///< at each row of `path`: holds the next repetition with 95 % probability [m]
  double typical_radius = 0;        ///< the same from the spread of the whole path [m]
  bool contacts = false;            ///< the forces hold the contacts with a scene
  std::vector<std::string> notes;   ///< messages for the user
};

/// Averages recordings of one task, each smoothed like the reference of a playback; see average_paths(). Forces are
/// left out, with a note, unless all recordings have them, with or without a scene. Reads the whole paths. Throws
/// Error(input) like average_paths() and PathSource::read.
AveragedExpert average_experts(std::span<const std::shared_ptr<const PathSource>> experts,
                               std::optional<double> smoothing = std::nullopt);

/// Writes the average as a recording that play, guide, programmes and reports read. Its column tunnel_radius holds the
/// radius, and its events hold the pauses. `scene_of`: a recording whose scene the forces hold; may be empty. Throws
/// Error(input) like save_path().
void save_average(const AveragedExpert& expert, const std::string& file, const std::string& title, bool overwrite,
                  const std::string& scene_of);

}  // namespace haptrace
