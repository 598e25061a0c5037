// Data of a recording, read from its file when a page asks for them. Private to view.
#pragma once

#include "formats/recording/recording.h"
#include "formats/recording/recording_summary.h"
#include "view/view_log.h"
#include "view/view_source.h"

#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace haptrace {

/// One recording. Its pyramid is built block by block: first the blocks that a page asks for, then their neighbours.
/// Until a block is built, bins come from the overview in the file.
///
/// Threads: one at a time, which alone uses HDF5.
class ViewedRecording final : public ViewSource {
 public:
  static constexpr std::chrono::milliseconds kPatience{100};

  /// Opens a recording in any format. Throws Error(input).
  explicit ViewedRecording(const std::string& file, std::chrono::milliseconds patience = kPatience);
  ~ViewedRecording() override;

  /// Answers from what is built, after building for about the patience. If that is not all, the answer is coarse, and
  /// work() builds this stretch next.
  void ask(const ViewRequest& request, const Reply& reply) override;

  /// Builds one block. Returns false if nothing is left to do.
  bool work();

  [[nodiscard]] const ViewChannels& channels() const noexcept { return channels_; }
  [[nodiscard]] const RecordingHeader& header() const noexcept { return header_; }
  [[nodiscard]] double duration() const noexcept { return seconds(last_ns_ - first_ns_); }

  /// Returns the messages `recording` and `events`, and the path.
  [[nodiscard]] nlohmann::json recording(std::size_t index, const std::string& name) const;
  [[nodiscard]] nlohmann::json events() const;
  [[nodiscard]] Frame path() const;

  /// Looks for the phases of further rows, for about `patience`. Returns true when all rows were seen.
  bool scan_phases(std::chrono::milliseconds patience);
  [[nodiscard]] const PhaseLog& phases() const noexcept { return phases_; }

  /// Returns what is wrong with the file, in words; empty if nothing was found so far.
  [[nodiscard]] const std::string& damage() const noexcept { return damage_; }
  /// Returns true if the recording has no end: a session still writes it, or was killed.
  [[nodiscard]] bool unfinished() const noexcept { return unfinished_; }

 private:
  static constexpr std::size_t kMostWanted = 4;

  void open_stream(const std::string& file);
  void read_overview();
  [[nodiscard]] std::uint64_t row_from(std::int64_t time_ns) const;
  void build(std::int64_t block);
  [[nodiscard]] std::optional<std::int64_t> missing_block(const ViewRequest& request) const;
  [[nodiscard]] std::optional<std::int64_t> next_block() const;
  [[nodiscard]] std::int64_t width_of(const ViewRequest& request) const;
  [[nodiscard]] Frame coarse(const ViewRequest& request);
  void scan_some_phases();
  [[nodiscard]] std::vector<Sample> read_run() const;

  std::chrono::milliseconds patience_;
  std::optional<RecordingReader> reader_;  ///< absent: all rows are in memory
  RecordingHeader header_;
  RecordingColumns columns_;
  ViewChannels channels_;
  std::uint64_t rows_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0;
  std::vector<RecordingSummary> overview_;
  std::vector<StoredEvent> events_;
  std::optional<History> history_;
  std::deque<ViewRequest> wanted_;  ///< the last ones that could not be answered exactly
  PhaseLog phases_;
  std::uint64_t scanned_ = 0, scan_end_ = 0;  ///< rows whose phase is known; end of the present block of the overview
  std::size_t scanned_parts_ = 0;             ///< blocks of the overview that were looked at
  bool phases_known_ = false;
  std::int64_t focus_ = 0;  ///< block that was asked for last
  bool unfinished_ = false;
  std::string damage_;
};

}  // namespace haptrace
