// Learned forces for a path on a device, stored beside the path for later sessions.
#pragma once

#include "control/iterative_learning.h"
#include "formats/documents/device_profile.h"
#include "formats/path/path_source.h"

#include <optional>
#include <string>

namespace haptrace {

struct LearnedPath {
  DeviceIdentity device;
  std::string path_digest;   ///< of the path as it was played, see digest_of()
  double speed = 1;          ///< relative to the path's own speed
  Vec3 mass = Vec3::Zero();  ///< mass of the inertial force, which the learned force does not include [kg]
  int repetitions = 0;       ///< number of repetitions that were learned from
  double rms_error = 0;      ///< measured error of the last repetition [m]
  std::string created;       ///< RFC 3339, UTC
  std::string software;
  ForceTable table;
};

/// Returns 16 hexadecimal digits for the times and positions of a path (FNV-1a). Reads the whole path.
std::string digest_of(const PathSource& path);

/// Returns the file for a device, in a folder beside the path: the path's name with ".learned" appended. A path that is
/// changed before it is played has a file of its own, named by `change`, its description; empty: not changed.
std::string learned_file(const std::string& path, const DeviceIdentity& device, const std::string& change = {});

/// Checks that the file can be saved, before the session starts. Throws like save_learned(), as far as it can know.
void check_learned_output(const std::string& file);

/// Saves the learned force and replaces an older file. Throws Error(input) if the folder cannot be created or a write
/// to the disk fails.
void save_learned(const LearnedPath& learned, const std::string& file);

/// Reads the file; returns nothing if there is none. Throws Error(input) naming the key.
std::optional<LearnedPath> load_learned(const std::string& file);

/// Returns why `learned` must not be used here; empty if it may. Reasons are another device or path, another speed, a
/// later calibration that found another mass, or forces that are far beyond the device's `max_force` [N] or change
/// faster than those that learning finds.
std::string check_learned(const LearnedPath& learned, const DeviceIdentity& device, const std::string& path_digest,
                          double speed, const Vec3& mass, double max_force);

}  // namespace haptrace
