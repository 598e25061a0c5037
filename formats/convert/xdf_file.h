// Chunks of XDF, the Extensible Data Format of the Lab Streaming Layer. Private to formats.
//
// A file is "XDF:" followed by chunks: [1, 4 or 8][length, in that many bytes][tag, 2 bytes][content], little-endian.
// The length counts tag and content. Tags: 1 file header (XML), 2 stream header (id, XML), 3 samples (id, number,
// samples), 4 clock offset (id, time, offset), 5 boundary (a constant mark), 6 stream footer (id, XML).
#pragma once

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace haptrace::xdf {

enum class Tag : std::uint16_t { file_header = 1, stream_header, samples, clock_offset, boundary, stream_footer };

/// Reads the chunks of a file in order. Memory is that of the largest loaded chunk, which is bounded.
///
/// After an invalid length it resumes after the next boundary chunk, and adds a note. A file that ends within a chunk
/// was left by a writer that died.
class ChunkWalk {
 public:
  /// Throws Error(input) if the file is not readable or not XDF.
  explicit ChunkWalk(const std::string& file);

  /// Moves to the next chunk. Returns false at the end.
  bool next();
  [[nodiscard]] Tag tag() const noexcept { return tag_; }
  /// Returns the stream of the present chunk; 0 for chunks of the file.
  [[nodiscard]] std::uint32_t stream() const noexcept { return stream_; }

  /// Returns the content after tag and stream, or as much of it as the file has. Throws Error(input) if it is larger
  /// than 1 GiB.
  std::string content();

  [[nodiscard]] double fraction() const noexcept;
  [[nodiscard]] const std::vector<std::string>& notes() const noexcept { return notes_; }
  [[nodiscard]] const std::string& file() const noexcept { return file_; }

 private:
  /// Reads the head of the chunk at position_. Returns false if it is invalid.
  bool read_head();
  void note(std::string text);
  bool find_boundary();

  std::string file_;
  std::ifstream stream_of_bytes_;
  std::uint64_t size_ = 0, position_ = 4;        ///< [bytes]; position_: start of the next chunk
  std::uint64_t content_ = 0, content_end_ = 0;  ///< content of the present chunk, from and to
  bool cut_off_ = false;                         ///< the file ends before the chunk does
  Tag tag_{};
  std::uint32_t stream_ = 0;
  std::vector<std::string> notes_;
};

enum class Format { float32, double64, int8, int16, int32, int64, text };

struct Channel {
  std::string label, unit;
};

/// Contents of a stream header.
struct StreamInfo {
  std::uint32_t id = 0;
  std::string name, type;
  Format format = Format::float32;
  double nominal_rate = 0;  ///< [Hz]; 0: irregular
  std::size_t channel_count = 0;
  std::vector<Channel> channels;  ///< one per channel; labels and units may be empty
};

/// Parses the header of a stream. Throws Error(input) if it is not XML, has no channels or an unknown format.
StreamInfo parse_stream_header(std::uint32_t id, const std::string& xml);

/// Returns the text of <info><`key`> in a file header; empty if it is absent.
std::string file_header_text(const std::string& xml, const char* key);

/// Reads the samples of one chunk. A chunk with fewer samples than it states ends early.
class SampleWalk {
 public:
  SampleWalk() = default;
  SampleWalk(const StreamInfo* info, std::string content);

  /// Reads the next sample. Returns false at the end. Leaves `time` empty if the sample has no stamp of its own.
  bool next(std::optional<double>& time, std::vector<double>& values, std::vector<std::string>& texts);
  [[nodiscard]] bool complete() const noexcept { return complete_; }  ///< all stated samples are present

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

/// Maps times of a remote clock to the recorder's clock, by measured offsets: t + a + b (t - t0). The line is a robust
/// fit (Huber's weights, full weight up to 0.1 ms), since network delays make the offsets noisy. An offset that jumps
/// by more than a second means that the clock was reset. Each part between resets has its own line, and a stamp belongs
/// to the part with the nearest measurements.
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
