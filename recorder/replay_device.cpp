#include "recorder/replay_device.h"

#include "base/error.h"
#include "devices/device_spec.h"
#include "devices/loop/prefetcher.h"
#include "formats/documents/device_profile.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_summary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::array<std::string_view, 3> kColumns{"time", "position", "force_measured"};

/// Sets the workspace to the box of a movement plus a margin, so that no side of it is zero.
void set_workspace(DeviceInfo& info, const Box& box) {
  constexpr double kMargin = 1e-3;  // [m]
  info.workspace_min = box.min.array() - kMargin;
  info.workspace_max = box.max.array() + kMargin;
}

/// Reads a recording row by row. Unlike open_path, it includes every phase of a session and the measured force.
class RecordedRows {
 public:
  explicit RecordedRows(const std::string& file) : reader_(file) {
    const RecordingSummary summary = summarise(reader_);
    if (summary.rows == summary.without_position) throw input_error(file + ": the file contains no position to replay");
    info_.natural_duration = summary.duration();
    set_workspace(info_, summary.bounds);
    const RecordingHeader header = reader_.header();
    info_.model = device_in_words(DeviceIdentity{header.device_backend, header.device_model, ""});
    info_.serial = header.device_serial;
    info_.position_resolution = header.position_resolution_m;
    info_.max_force = header.max_force_n;
    info_.nominal_rate = header.rate_hz;
    info_.measures_force = reader_.columns().force_measured;
    // Skip the rows before the first position.
    while (!is_finite(reader_.read(begin_, 1, kColumns).front().position)) ++begin_;
  }

  [[nodiscard]] const DeviceInfo& info() const { return info_; }
  [[nodiscard]] std::size_t blocks() const {
    return (reader_.rows() - begin_ + ReplayDevice::kBlock - 1) / ReplayDevice::kBlock;
  }

  [[nodiscard]] ReplayDevice::Rows read(std::size_t block) const {
    // Read the following row as well, for its time.
    const std::vector<Sample> samples =
        reader_.read(begin_ + block * ReplayDevice::kBlock, ReplayDevice::kBlock + 1, kColumns);
    ReplayDevice::Rows rows;
    for (std::size_t i = 0; i < std::min<std::size_t>(samples.size(), ReplayDevice::kBlock); ++i) {
      rows.time_ns.push_back(samples[i].time_ns);
      rows.position.push_back(samples[i].position);
      if (info_.measures_force) rows.force.push_back(samples[i].force_measured);
    }
    if (samples.size() > ReplayDevice::kBlock) rows.until_ns = samples.back().time_ns;
    return rows;
  }

 private:
  RecordingReader reader_;
  DeviceInfo info_;
  std::uint64_t begin_ = 0;
};

std::unique_ptr<Device> replay_recording(const std::string& file, const std::string& name) {
  const auto recorded = std::make_shared<const RecordedRows>(file);
  DeviceInfo info = recorded->info();
  info.name = name;
  return std::make_unique<ReplayDevice>(
      info, std::make_shared<const ReplayDevice::Rows>(recorded->read(0)), recorded->blocks(),
      [recorded](std::size_t block) { return std::make_unique<const ReplayDevice::Rows>(recorded->read(block)); });
}

std::unique_ptr<Device> replay_path(const std::string& file, const std::string& name) {
  const Path path = load_path(file);
  DeviceInfo info;
  info.name = name;
  info.model = "path";
  if (path.duration() > 0) info.nominal_rate = static_cast<double>(path.size() - 1) / path.duration();
  info.notes = path.notes;
  ReplayDevice::Rows rows;
  for (const double t : path.time) rows.time_ns.push_back(std::llround(1e9 * (t - path.time.front())));
  rows.position = path.position;
  return std::make_unique<ReplayDevice>(info, std::move(rows));
}

std::unique_ptr<Device> open_replay(const DeviceSpec& spec) {
  const auto file = spec.options.find("file");
  if (file == spec.options.end())
    throw input_error(fmt::format("--device '{}': the option file is missing; use replay:file=NAME.h5", spec.text));
  return is_hdf5(file->second) ? replay_recording(file->second, spec.text) : replay_path(file->second, spec.text);
}

DeviceInfo info_of(DeviceInfo info, const ReplayDevice::Rows& rows) {
  info.natural_duration = 1e-9 * static_cast<double>(rows.time_ns.back() - rows.time_ns.front());
  Box box;
  for (const Vec3& p : rows.position)
    if (is_finite(p)) box.include(p);
  set_workspace(info, box);
  return info;
}

}  // namespace

ReplayDevice::ReplayDevice(const DeviceInfo& info, Rows rows)
    : ReplayDevice(info, std::make_shared<const Rows>(std::move(rows))) {}

ReplayDevice::ReplayDevice(const DeviceInfo& info, std::shared_ptr<const Rows> rows)
    : ReplayDevice(info_of(info, *rows), rows, 1, nullptr) {}

ReplayDevice::ReplayDevice(DeviceInfo info, std::shared_ptr<const Rows> first, std::size_t blocks,
                           Prefetcher<Rows>::Load load)
    : info_(std::move(info)),
      blocks_(blocks),
      prefetcher_(std::move(first), blocks, 2, std::move(load)),
      rows_(prefetcher_.get(0)) {
  info_.backend = "replay";
  info_.virtual_time = true;
  take(0);
}

void ReplayDevice::take(std::size_t row) noexcept {
  row_ = row;
  if (!is_finite(rows_->position[row])) return;
  state_.position = rows_->position[row];
  if (!rows_->force.empty()) state_.force = rows_->force[row];
}

bool ReplayDevice::advance(std::int64_t now) noexcept {
  for (;;) {
    while (row_ + 1 < rows_->time_ns.size() && rows_->time_ns[row_ + 1] <= now) take(row_ + 1);
    if (now < rows_->until_ns || block_ + 1 == blocks_) return true;
    const Rows* next = prefetcher_.get(block_ + 1);
    if (next == nullptr) return !prefetcher_.failed(block_ + 1);
    rows_ = next;
    ++block_;
    take(0);
  }
}

Device::Status ReplayDevice::exchange(const Wrench&, double dt, DeviceState& state) noexcept {
  if (closed_ || !advance(time_.advance(dt))) return Status::lost;
  state = state_;
  return Status::ok;
}

void ReplayDevice::between_ticks(bool may_wait) noexcept {
  if (may_wait && block_ + 1 < blocks_) prefetcher_.wait(block_ + 1);
}

std::string ReplayDevice::lost_reason() const {
  return closed_ ? "the replay is closed" : prefetcher_.error();
}

DeviceBackend replay_backend() {
  return {.name = "replay",
          .summary = "a recording that answers as if it were the device, in virtual time",
          .options = {{"file", "recording (HDF5) or path (CSV)"}},
          .presets = {},
          .open = open_replay};
}

}  // namespace haptrace
