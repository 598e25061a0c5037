// Columns of the live view: what a page shows of a sample. Private to view.
#pragma once

#include "control/sample.h"
#include "formats/recording/recording.h"

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace haptrace {

/// One column of a view.
struct ViewChannel {
  const char* name;  ///< as in docs/view-protocol.md
  const char* unit;
  double (*value)(const Sample& sample, const ContactSample* contact);  ///< NaN: not measured
  bool (*in)(const RecordingColumns& columns);
};

/// Columns of a view, in the order of the protocol.
///
/// Real-time: none of it; the thread of the view calls it.
class ViewChannels {
 public:
  ViewChannels() = default;
  explicit ViewChannels(const RecordingColumns& columns);

  [[nodiscard]] std::size_t size() const noexcept { return channels_.size(); }
  [[nodiscard]] const ViewChannel& operator[](std::size_t index) const { return *channels_[index]; }

  /// Returns the index of a column; nothing if the session does not have it.
  [[nodiscard]] std::optional<std::size_t> find(std::string_view name) const noexcept;

  /// Writes the values of a sample, one for each column. `contact`: the strongest of its tick; null: nothing is
  /// touched.
  void fill(const Sample& sample, std::span<float> values, const ContactSample* contact = nullptr) const;

 private:
  std::vector<const ViewChannel*> channels_;
};

}  // namespace haptrace
