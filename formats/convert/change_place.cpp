#include "formats/convert/change_place.h"

#include "formats/documents/device_profile.h"
#include "formats/recording/recording_formats.h"

#include <array>
#include <utility>
#include <vector>

namespace haptrace {
namespace {

constexpr const char* kKey = "path_change";  // of the metadata

class ChangedSource final : public RecordingSource {
 public:
  ChangedSource(std::unique_ptr<RecordingSource> source, const Similarity& change, const std::string& description)
      : source_(std::move(source)), header_(source_->header()), change_(change) {
    header_.uuid = new_uuid();
    std::string& changes = header_.meta[kKey];
    changes += (changes.empty() ? "" : "; then ") + description;
    scene_left_out_ = !header_.scene.empty();
    header_.scene = {};
    header_.meta.erase(kDynamicsKey);  // along the device's axes
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return source_->events(); }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return source_->clocks(); }

  std::span<const Sample> next() override {
    const std::span<const Sample> samples = source_->next();
    samples_.assign(samples.begin(), samples.end());
    for (Sample& sample : samples_) change(sample);
    const std::span<const ContactSample> contacts = source_->contacts();
    contacts_.assign(contacts.begin(), contacts.end());
    for (ContactSample& contact : contacts_) change(contact);
    return samples_;
  }

  [[nodiscard]] std::span<const ContactSample> contacts() const override { return contacts_; }
  void skip_to(std::int64_t time_ns) override { source_->skip_to(time_ns); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }

  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = source_->notes();
    if (scene_left_out_) notes.emplace_back("the scene was left out, because it does not move with the recording");
    return notes;
  }

 private:
  void change(Sample& sample) const {
    for (Vec3 Sample::*point : {&Sample::position, &Sample::reference_position})
      sample.*point = change_.point(sample.*point);
    for (Vec3 Sample::*velocity : {&Sample::velocity, &Sample::reference_velocity})
      sample.*velocity = change_.velocity(sample.*velocity);
    for (Vec3 Sample::*force : {&Sample::force, &Sample::force_measured, &Sample::support, &Sample::reference_force})
      sample.*force = change_.direction(sample.*force);
    for (Quat Sample::*orientation : {&Sample::orientation, &Sample::reference_orientation})
      sample.*orientation = change_.orientation(sample.*orientation);
    for (Vec3 Sample::*gain : {&Sample::kp, &Sample::kd}) sample.*gain = change_.gain(sample.*gain);
    sample.torque = change_.torque(sample.torque);
    sample.progress *= change_.scale;
    sample.tunnel_radius *= change_.scale;
  }

  void change(ContactSample& contact) const {
    contact.proxy = change_.point(contact.proxy);
    contact.normal = change_.direction(contact.normal);
    contact.force = change_.direction(contact.force);
    contact.depth *= change_.scale;
  }

  std::unique_ptr<RecordingSource> source_;
  RecordingHeader header_;
  Similarity change_;
  bool scene_left_out_ = false;
  std::vector<Sample> samples_;
  std::vector<ContactSample> contacts_;
};

}  // namespace

std::unique_ptr<RecordingSource> change_place(std::unique_ptr<RecordingSource> source, const Similarity& change,
                                              const std::string& description) {
  return std::make_unique<ChangedSource>(std::move(source), change, description);
}

}  // namespace haptrace
