// Data of the running session, in memory. Private to view.
#pragma once

#include "view/live_view.h"
#include "view/view_log.h"
#include "view/view_source.h"

#include <optional>

namespace haptrace {

/// Samples, events and phases of one session.
///
/// Threads: one.
class LiveSource final : public ViewSource {
 public:
  /// `session.columns` are those of its samples.
  explicit LiveSource(const ViewedSession& session);

  void ask(const ViewRequest& request, const Reply& reply) override;

  /// Adds a sample to the rows that wait for take().
  void add(const Sample& sample, const ContactSample* contact = nullptr);

  /// Returns the rows since the last call.
  ViewRows take();

  /// Returns rows after `time` [s], those of the last `most` [s] at most.
  [[nodiscard]] ViewRows rows_after(double time, double most) const;

  [[nodiscard]] const ViewChannels& channels() const noexcept { return channels_; }
  [[nodiscard]] const std::optional<Sample>& newest() const noexcept { return newest_; }
  [[nodiscard]] double time() const noexcept;  ///< of the newest sample [s]

  /// Returns the fresh rows per second over the last second or two [Hz].
  [[nodiscard]] double rate() const noexcept;

  PhaseLog phases;

 private:
  ViewChannels channels_;
  History history_;
  ViewRows fresh_;
  std::vector<float> values_;
  std::optional<Sample> newest_;
  std::uint64_t rows_ = 0;
  std::int64_t window_ns_ = 0, window_length_ns_ = 0;  ///< present window of the rate, and the length of the last
  std::uint64_t window_rows_ = 0, last_window_rows_ = 0;
};

}  // namespace haptrace
