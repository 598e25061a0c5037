#include "formats/recording_recover.h"

#include "control/error.h"
#include "formats/hdf5_support.h"
#include "formats/output_file.h"
#include "formats/recording_layout.h"
#include "formats/recording_lock.h"

#include <algorithm>
#include <filesystem>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::uint64_t kRecoveredBlock = 8192;  // rows
constexpr std::uint64_t kSmallest = 64;          // rows that are given up together when one of them cannot be read

/// Bit for bit, in the columns that a file has.
bool same(std::span<const Sample> a, std::span<const Sample> b, const RecordingColumns& columns) {
  std::vector<std::byte> left, right;
  return a.size() == b.size() &&
         std::all_of(layout::columns().begin(), layout::columns().end(), [&](const layout::Column& column) {
           if (!column.in(columns)) return true;
           left.resize(a.size() * column.row_bytes());
           right.resize(left.size());
           column.pack(a, left.data());
           column.pack(b, right.data());
           return left == right;
         });
}

/// Rows [first, first + count) as far as they can be read. Adds those that cannot to `unreadable`.
std::vector<Sample> read_what_can_be(const RecordingReader& reader, std::uint64_t first, std::uint64_t count,
                                     std::uint64_t& unreadable) {
  try {
    return reader.read(first, count);
  } catch (const Error&) {
    if (count <= kSmallest) {
      unreadable += count;
      return {};
    }
    std::vector<Sample> samples = read_what_can_be(reader, first, count / 2, unreadable);
    const std::vector<Sample> rest = read_what_can_be(reader, first + count / 2, count - count / 2, unreadable);
    samples.insert(samples.end(), rest.begin(), rest.end());
    return samples;
  }
}

std::vector<StoredEvent> events_of(const RecordingReader& reader, Recovery& recovery) {
  try {
    return reader.events();
  } catch (const Error& error) {
    recovery.notes.push_back(fmt::format("the events are lost: {}", error.what()));
    return {};
  }
}

/// What can be read of a file, in blocks, and how much cannot.
class Salvage {
 public:
  explicit Salvage(const RecordingReader& reader) : reader_(reader) {}

  /// Calls `visit(samples)` for every block in order and `progress` with the part that is done.
  template <class Visit>
  void for_each(const Visit& visit, const std::function<void(double)>& progress) {
    unreadable_ = 0;
    for (std::uint64_t first = 0; first < reader_.rows(); first += kRecoveredBlock) {
      visit(read_what_can_be(reader_, first, std::min(kRecoveredBlock, reader_.rows() - first), unreadable_));
      if (progress) progress(static_cast<double>(first) / static_cast<double>(reader_.rows()));
    }
  }
  [[nodiscard]] std::uint64_t unreadable() const noexcept { return unreadable_; }

 private:
  const RecordingReader& reader_;
  std::uint64_t unreadable_ = 0;
};

/// Writes what can be read of `reader` into the empty file `copy`, and proves that it is there.
void copy_part(const RecordingReader& reader, const std::string& copy, const std::function<void(double)>& progress,
               Recovery& recovery) {
  Salvage salvage(reader);
  const auto half = [&](double begin) {
    return [&progress, begin](double done) {
      if (progress) progress(begin + 0.5 * done);
    };
  };
  RecordingWriter writer(copy, reader.header(), reader.columns(),
                         {.overwrite = true, .storage = {.deflate = reader.deflate()}, .keep_part = true});
  double end = 0;
  salvage.for_each(
      [&](const std::vector<Sample>& samples) {
        writer.append(samples);
        if (!samples.empty()) end = 1e-9 * static_cast<double>(samples.back().time_ns);
      },
      half(0));
  for (const StoredEvent& event : events_of(reader, recovery)) writer.append(event);
  const Event recovered{
      .code = EventCode::recovered,
      .values = {static_cast<double>(writer.rows()), static_cast<double>(salvage.unreadable()), kNaN}};
  writer.append(StoredEvent{.time = end, .code = static_cast<int>(recovered.code), .text = describe(recovered)});
  writer.finish();

  const RecordingReader written(copy, RecordingReader::Parts::this_file);
  std::uint64_t row = 0;
  salvage.for_each(
      [&](const std::vector<Sample>& samples) {
        if (!same(samples, written.read(row, samples.size()), reader.columns()))
          throw input_error(fmt::format("{}: what was written is not what is read back; is the disk broken?", copy));
        row += samples.size();
      },
      half(0.5));
  if (row != written.rows()) throw input_error(fmt::format("{}: has {} rows instead of {}", copy, written.rows(), row));
  recovery.samples += row;
  recovery.unreadable += salvage.unreadable();
}

bool is_whole(const std::string& file) {
  const RecordingReader reader(file, RecordingReader::Parts::this_file);
  if (!reader.header().complete || hdf5::was_left_open(file)) return false;
  Salvage salvage(reader);
  salvage.for_each([](const auto&) {}, {});
  return salvage.unreadable() == 0;
}

}  // namespace

Recovery recover_recording(const std::string& file, const std::string& output, bool overwrite,
                           const std::function<void(double)>& progress) {
  const std::uint32_t parts = RecordingReader(file).parts();
  for (std::uint32_t part = 1; part <= parts; ++part)
    if (has_writer(part_file(file, part)))
      throw input_error(
          fmt::format("{}: is being written by a running session; end that first", part_file(file, part)));

  Recovery recovery;
  for (std::uint32_t part = 1; part <= parts; ++part) {
    const std::string source = part_file(file, part);
    const RecordingReader reader(source, RecordingReader::Parts::this_file);
    if (output.empty() && is_whole(source)) {
      recovery.samples += reader.rows();
      continue;
    }
    recovery.needed = true;
    OutputFile target(output.empty() ? source : part_file(output, part), output.empty() || overwrite);
    target.create();
    std::filesystem::permissions(target.path(), std::filesystem::status(source).permissions());
    copy_part(
        reader, target.path(),
        [&](double done) {
          if (progress) progress((part - 1 + done) / parts);
        },
        recovery);
    target.commit();
    recovery.files.push_back(output.empty() ? source : part_file(output, part));
  }
  return recovery;
}

}  // namespace haptrace
