// XDF, the Extensible Data Format of the Lab Streaming Layer: its chunks and what is in them. Private to formats.
//
// A file is "XDF:" and chunks: [1, 4 or 8][length, of so many bytes][tag, 2 bytes][content], little-endian. The length
// counts tag and content. Tags: 1 file header (XML), 2 stream header (id, XML), 3 samples (id, number, samples), 4
// clock offset (id, time, offset), 5 boundary (a mark that never changes), 6 stream footer (id, XML).
#pragma once

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::xdf {

enum class Tag : std::uint16_t { file_header = 1, stream_header, samples, clock_offset, boundary, stream_footer };

/// Walks the chunks of a file. Memory is that of the largest chunk that is loaded, which is bounded.
///
/// Where the lengths make no sense, it goes on behind the next boundary chunk, and says so; a file that ends within a
/// chunk is one whose writer died.
class ChunkWalk {
 public:
  /// Throws Error(input): not readable, not XDF.
  explicit ChunkWalk(const std::string& file);

  /// False at the end.
  bool next();
  [[nodiscard]] Tag tag() const noexcept { return tag_; }
  /// The stream the present chunk belongs to; 0 for those of the file.
  [[nodiscard]] std::uint32_t stream() const noexcept { return stream_; }

  /// The content behind tag and stream; of a chunk that the file does not have all of, what there is. Throws
  /// Error(input) when it is larger than 1 GiB.
  std::string content();

  [[nodiscard]] double fraction() const noexcept;
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept { return notes_; }
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

 private:
  /// Reads what stands before the content at position_; false when it makes no sense.
  bool read_head();
  void note(std::string text);
  bool find_boundary();

  std::string file_;
  std::ifstream stream_of_bytes_;
  std::uint64_t size_ = 0, position_ = 4;        ///< [bytes]; where the next chunk begins
  std::uint64_t content_ = 0, content_end_ = 0;  ///< of the present chunk
  bool cut_off_ = false;                         ///< the file ends before the chunk does
  Tag tag_{};
  std::uint32_t stream_ = 0;
  std::vector<std::string> notes_;
};

enum class Format { float32, double64, int8, int16, int32, int64, text };

struct Channel {
  std::string label, unit;
};

/// What a stream's header says.
struct StreamInfo {
  std::uint32_t id = 0;
  std::string name, type;
  Format format = Format::float32;
  double nominal_rate = 0;  ///< [Hz]; 0: irregular
  std::size_t channel_count = 0;
  std::vector<Channel> channels;  ///< as many; labels and units may be empty
};

/// Throws Error(input): not XML, no channels, an unknown format.
StreamInfo parse_stream_header(std::uint32_t id, const std::string& xml);

/// The text of <info><`key`> in a file header; empty when there is none.
std::string file_header_text(const std::string& xml, const char* key);

/// The samples of one chunk. A chunk that lies about their number ends early.
class SampleWalk {
 public:
  SampleWalk() = default;
  SampleWalk(const StreamInfo* info, std::string content);

  /// Reads the next sample; false at the end. `time` is left empty when the sample has no stamp of its own.
  bool next(std::optional<double>& time, std::vector<double>& values, std::vector<std::string>& texts);
  [[nodiscard]] bool complete() const noexcept { return complete_; }  ///< all that were promised were there

 private:
  template <class Value>
  bool take(Value& value);
  bool take_length(std::uint64_t& length);
  bool take_value(double& value);
  bool take_text(std::string& text);

  const StreamInfo* info_ = nullptr;
  std::string content_;
  std::size_t at_ = 0;
  std::uint64_t left_ = 0;
  bool complete_ = true;
};

/// Measurements of a remote clock against the recorder's, and the map they make: t + a + b (t - t0), a robust line
/// (Huber's weights, at most 0.1 ms counts in full) through the offsets, which are noisy by the network's delays. A
/// jump of more than a second is a clock that was set anew: each part has its own line, a stamp belongs to the part
/// whose measurements are nearest.
class ClockMap {
 public:
  void add(double time, double offset);
  void fit();
  [[nodiscard]] double to_recorder(double time) const;
  [[nodiscard]] std::size_t parts() const noexcept { return parts_.size(); }

 private:
  struct Part {
    std::vector<double> times, offsets;
    double a = 0, b = 0, t0 = 0;
  };
  std::vector<Part> parts_;
};

}  // namespace haptrace::xdf
