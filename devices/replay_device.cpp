#include "devices/replay_device.h"

#include "control/error.h"
#include "control/path.h"
#include "formats/path_file.h"
#include "formats/recording.h"

#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Reads a recording row by row: unlike load_path, with every phase of a session and with the force it measured.
ReplayDevice::Recording from_recording(const std::string& file) {
  constexpr std::uint64_t kRowsAtOnce = 65536;
  const RecordingReader reader(file);
  const RecordingHeader& header = reader.header();

  ReplayDevice::Recording recording;
  recording.info.model = header.device_model;
  recording.info.serial = header.device_serial;
  recording.info.position_resolution = header.position_resolution_m;
  recording.info.max_force = header.max_force_n;
  recording.info.nominal_rate = header.rate_hz;
  recording.info.measures_force = reader.columns().force_measured;
  for (std::uint64_t row = 0; row < reader.rows(); row += kRowsAtOnce) {
    for (const Sample& sample : reader.read(row, kRowsAtOnce)) {
      if (!is_finite(sample.position)) continue;
      recording.time_ns.push_back(sample.time_ns);
      recording.position.push_back(sample.position);
      if (recording.info.measures_force) recording.force.push_back(sample.force_measured);
    }
  }
  return recording;
}

ReplayDevice::Recording from_path(const std::string& file) {
  const Path path = load_path(file);
  ReplayDevice::Recording recording;
  recording.info.model = "path";
  if (path.duration() > 0) recording.info.nominal_rate = static_cast<double>(path.size() - 1) / path.duration();
  recording.info.notes = path.notes;
  for (const double t : path.time) recording.time_ns.push_back(std::llround(1e9 * (t - path.time.front())));
  recording.position = path.position;
  return recording;
}

std::unique_ptr<Device> open_replay(const DeviceSpec& spec) {
  const auto file = spec.options.find("file");
  if (file == spec.options.end())
    throw input_error(fmt::format("--device '{}': which recording? Say replay:file=NAME.h5", spec.text));
  auto recording = is_hdf5(file->second) ? from_recording(file->second) : from_path(file->second);
  if (recording.position.empty()) throw input_error(file->second + ": holds no position to replay");
  recording.info.name = spec.text;
  return std::make_unique<ReplayDevice>(std::move(recording));
}

}  // namespace

ReplayDevice::ReplayDevice(Recording recording) : recording_(std::move(recording)) {
  DeviceInfo& info = recording_.info;
  info.backend = "replay";
  info.virtual_time = true;
  info.natural_duration = 1e-9 * static_cast<double>(recording_.time_ns.back() - recording_.time_ns.front());
  // Where the recording went, and a little more: a box has a size even where a movement has none.
  constexpr double kMargin = 1e-3;  // [m]
  Box box;
  for (const Vec3& p : recording_.position) box.include(p);
  info.workspace_min = box.min.array() - kMargin;
  info.workspace_max = box.max.array() + kMargin;
}

Device::Status ReplayDevice::exchange(const Wrench&, double dt, DeviceState& state) noexcept {
  if (closed_) return Status::lost;
  const std::int64_t now = time_.advance(dt);
  const auto& times = recording_.time_ns;
  while (row_ + 1 < times.size() && times[row_ + 1] <= now) ++row_;

  state = DeviceState{};
  state.position = recording_.position[row_];
  if (!recording_.force.empty()) state.force = recording_.force[row_];
  return Status::ok;
}

DeviceBackend replay_backend() {
  return {.name = "replay",
          .summary = "a recording that answers as if it were the device, in virtual time",
          .options = {{"file", "the recording: HDF5, or a path as CSV"}},
          .presets = {},
          .open = open_replay};
}

}  // namespace haptrace
