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
bool contacts(const Columns& columns) {
  return columns.contacts;
}

template <Vec3 ContactSample::*Member, int Axis>
double of_contact(const Sample&, const ContactSample* contact) {
  return contact != nullptr ? (contact->*Member)[Axis] : kNaN;
}

constexpr ViewChannel kViewChannels[] = {
    {"x", "m", [](const Sample& s, const ContactSample*) { return s.position.x(); }, always},
    {"y", "m", [](const Sample& s, const ContactSample*) { return s.position.y(); }, always},
    {"z", "m", [](const Sample& s, const ContactSample*) { return s.position.z(); }, always},
    {"rx", "m", [](const Sample& s, const ContactSample*) { return s.reference_position.x(); }, reference},
    {"ry", "m", [](const Sample& s, const ContactSample*) { return s.reference_position.y(); }, reference},
    {"rz", "m", [](const Sample& s, const ContactSample*) { return s.reference_position.z(); }, reference},
    {"fx", "N", [](const Sample& s, const ContactSample*) { return s.force.x(); }, always},
    {"fy", "N", [](const Sample& s, const ContactSample*) { return s.force.y(); }, always},
    {"fz", "N", [](const Sample& s, const ContactSample*) { return s.force.z(); }, always},
    {"ex", "N", [](const Sample& s, const ContactSample*) { return s.reference_force.x(); }, guidance},
    {"ey", "N", [](const Sample& s, const ContactSample*) { return s.reference_force.y(); }, guidance},
    {"ez", "N", [](const Sample& s, const ContactSample*) { return s.reference_force.z(); }, guidance},
    {"progress", "m", [](const Sample& s, const ContactSample*) { return s.progress; }, guidance},
    {"radius", "m", [](const Sample& s, const ContactSample*) { return s.tunnel_radius; }, tunnel},
    {"deviation", "m", [](const Sample& s, const ContactSample*) { return (s.position - s.reference_position).norm(); },
     reference},
    {"force", "N", [](const Sample& s, const ContactSample*) { return s.force.norm(); }, always},
    {"speed", "m/s", [](const Sample& s, const ContactSample*) { return s.velocity.norm(); }, always},
    {"phase", "", [](const Sample& s, const ContactSample*) { return static_cast<double>(s.phase); }, always},
    {"buttons", "", [](const Sample& s, const ContactSample*) { return static_cast<double>(s.buttons); }, always},
    {"mx", "N", [](const Sample& s, const ContactSample*) { return s.force_measured.x(); }, measured},
    {"my", "N", [](const Sample& s, const ContactSample*) { return s.force_measured.y(); }, measured},
    {"mz", "N", [](const Sample& s, const ContactSample*) { return s.force_measured.z(); }, measured},
    {"qw", "", [](const Sample& s, const ContactSample*) { return s.orientation.w(); }, orientation},
    {"qx", "", [](const Sample& s, const ContactSample*) { return s.orientation.x(); }, orientation},
    {"qy", "", [](const Sample& s, const ContactSample*) { return s.orientation.y(); }, orientation},
    {"qz", "", [](const Sample& s, const ContactSample*) { return s.orientation.z(); }, orientation},
    {"proxy_x", "m", of_contact<&ContactSample::proxy, 0>, contacts},
    {"proxy_y", "m", of_contact<&ContactSample::proxy, 1>, contacts},
    {"proxy_z", "m", of_contact<&ContactSample::proxy, 2>, contacts},
    {"contact", "",
     [](const Sample&, const ContactSample* contact) {
       return contact != nullptr ? static_cast<double>(contact->object) : kNaN;
     },
     contacts},
    {"normal_x", "", of_contact<&ContactSample::normal, 0>, contacts},
    {"normal_y", "", of_contact<&ContactSample::normal, 1>, contacts},
    {"normal_z", "", of_contact<&ContactSample::normal, 2>, contacts},
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

void ViewChannels::fill(const Sample& sample, std::span<float> values, const ContactSample* contact) const {
  for (std::size_t i = 0; i < channels_.size(); ++i)
    values[i] = static_cast<float>(channels_[i]->value(sample, contact));
}

}  // namespace haptrace
