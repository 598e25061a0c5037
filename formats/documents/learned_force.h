// What was learned of a path on a device, kept beside the path for the sessions after it.
#pragma once

#include "control/iterative_learning.h"
#include "formats/documents/device_profile.h"
#include "formats/path/path_source.h"

#include <optional>
#include <string>

namespace haptrace {

struct LearnedPath {
  DeviceIdentity device;
  std::string path_digest;   ///< of the path as it was played: see digest_of
  double speed = 1;          ///< times the path's own
  Vec3 mass = Vec3::Zero();  ///< that the inertia was reckoned with: the rest of the force is what was learned [kg]
  int repetitions = 0;       ///< that were learned from
  double rms_error = 0;      ///< of the last of them, measured [m]
  std::string created;       ///< RFC 3339, UTC
  std::string software;
  ForceTable table;
};

/// 16 hexadecimal digits for the times and positions of a path (FNV-1a). Reads all of it.
std::string digest_of(const PathSource& path);

/// Beside the path, in a folder of its name with ".learned" behind it, a file for each device.
std::string learned_file(const std::string& path, const DeviceIdentity& device);

/// Before the session whose lesson the file is to hold. Throws what save_learned() would, as far as that shows
/// beforehand.
void check_learned_output(const std::string& file);

/// Throws Error(input): the folder cannot be made, the disk refuses. An older file is replaced.
void save_learned(const LearnedPath& learned, const std::string& file);

/// Nothing when there is no such file. Throws Error(input) naming the key.
std::optional<LearnedPath> load_learned(const std::string& file);

/// Why `learned` must not be used here, in words; empty when it may: another device or path, another speed, or a
/// calibration since then that found another mass.
std::string check_learned(const LearnedPath& learned, const DeviceIdentity& device, const std::string& path_digest,
                          double speed, const Vec3& mass);

}  // namespace haptrace
