#include "view/view_channels.h"

namespace haptrace {
namespace {

using Columns = RecordingColumns;

bool always(const Columns&) {
  return true;
}
bool reference(const Columns& columns) {
  return columns.reference;
}
bool guidance(const Columns& columns) {
  return columns.guidance;
}
bool tunnel(const Columns& columns) {
  return columns.tunnel;
}
bool measured(const Columns& columns) {
  return columns.force_measured;
}
bool orientation(const Columns& columns) {
  return columns.orientation;
}

constexpr ViewChannel kViewChannels[] = {
    {"x", "m", [](const Sample& s) { return s.position.x(); }, always},
    {"y", "m", [](const Sample& s) { return s.position.y(); }, always},
    {"z", "m", [](const Sample& s) { return s.position.z(); }, always},
    {"rx", "m", [](const Sample& s) { return s.reference_position.x(); }, reference},
    {"ry", "m", [](const Sample& s) { return s.reference_position.y(); }, reference},
    {"rz", "m", [](const Sample& s) { return s.reference_position.z(); }, reference},
    {"fx", "N", [](const Sample& s) { return s.force.x(); }, always},
    {"fy", "N", [](const Sample& s) { return s.force.y(); }, always},
    {"fz", "N", [](const Sample& s) { return s.force.z(); }, always},
    {"ex", "N", [](const Sample& s) { return s.reference_force.x(); }, guidance},
    {"ey", "N", [](const Sample& s) { return s.reference_force.y(); }, guidance},
    {"ez", "N", [](const Sample& s) { return s.reference_force.z(); }, guidance},
    {"progress", "m", [](const Sample& s) { return s.progress; }, guidance},
    {"radius", "m", [](const Sample& s) { return s.tunnel_radius; }, tunnel},
    {"deviation", "m", [](const Sample& s) { return (s.position - s.reference_position).norm(); }, reference},
    {"force", "N", [](const Sample& s) { return s.force.norm(); }, always},
    {"speed", "m/s", [](const Sample& s) { return s.velocity.norm(); }, always},
    {"phase", "", [](const Sample& s) { return static_cast<double>(s.phase); }, always},
    {"buttons", "", [](const Sample& s) { return static_cast<double>(s.buttons); }, always},
    {"mx", "N", [](const Sample& s) { return s.force_measured.x(); }, measured},
    {"my", "N", [](const Sample& s) { return s.force_measured.y(); }, measured},
    {"mz", "N", [](const Sample& s) { return s.force_measured.z(); }, measured},
    {"qw", "", [](const Sample& s) { return s.orientation.w(); }, orientation},
    {"qx", "", [](const Sample& s) { return s.orientation.x(); }, orientation},
    {"qy", "", [](const Sample& s) { return s.orientation.y(); }, orientation},
    {"qz", "", [](const Sample& s) { return s.orientation.z(); }, orientation},
};

}  // namespace

ViewChannels::ViewChannels(const RecordingColumns& columns) {
  for (const ViewChannel& channel : kViewChannels)
    if (channel.in(columns)) channels_.push_back(&channel);
}

std::optional<std::size_t> ViewChannels::find(std::string_view name) const noexcept {
  for (std::size_t i = 0; i < channels_.size(); ++i)
    if (name == channels_[i]->name) return i;
  return std::nullopt;
}

void ViewChannels::fill(const Sample& sample, std::span<float> values) const {
  for (std::size_t i = 0; i < channels_.size(); ++i) values[i] = static_cast<float>(channels_[i]->value(sample));
}

}  // namespace haptrace
