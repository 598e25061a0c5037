#include "formats/recording/recording_stream.h"

#include "base/error.h"
#include "base/output_file.h"
#include "base/text_file.h"
#include "formats/recording/recording_formats.h"

#include <algorithm>
#include <array>
#include <boost/uuid/uuid_generators.hpp>
#include <boost/uuid/uuid_io.hpp>
#include <cmath>
#include <filesystem>
#include <fmt/format.h>
#include <fstream>

namespace haptrace {
namespace {

class Hdf5Source final : public RecordingSource {
 public:
  Hdf5Source(const std::string& file, RecordingReader::Parts parts) : reader_(file, parts), header_(reader_.header()) {
    header_.part = 0;  // the output is always a whole recording
    header_.part_of.clear();
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return reader_.columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return reader_.events(); }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return reader_.clocks(); }

  std::span<const Sample> next() override {
    block_ = reader_.read(row_, kSourceBlock);
    row_ += block_.size();
    take_contacts();
    return block_;
  }

  [[nodiscard]] std::span<const ContactSample> contacts() const override { return contacts_; }

  void skip_to(std::int64_t time_ns) override {
    if (reader_.rows() > 0) row_ = std::max(row_, reader_.row_at(time_ns));
    contact_ = std::max(contact_, reader_.contact_at(time_ns));
  }

  [[nodiscard]] double fraction() const override {
    return reader_.rows() > 0 ? static_cast<double>(row_) / static_cast<double>(reader_.rows()) : 1;
  }
  [[nodiscard]] std::vector<std::string> notes() const override {
    if (!reader_.missing_parts().empty())
      return {fmt::format("parts of the recording are missing and were left out: {}",
                          fmt::join(reader_.missing_parts(), ", "))};
    if (header_.complete) return {};
    return {"the recording was not finished; the samples in the file were read"};
  }

 private:
  /// Takes the contacts up to the end of the block.
  void take_contacts() {
    contacts_.clear();
    if (block_.empty() || !reader_.columns().contacts) return;
    for (;;) {
      const std::vector<ContactSample> next = reader_.contacts(contact_, kSourceBlock);
      const auto end = std::find_if(next.begin(), next.end(),
                                    [&](const ContactSample& contact) { return contact.tick > block_.back().tick; });
      contacts_.insert(contacts_.end(), next.begin(), end);
      contact_ += static_cast<std::uint64_t>(end - next.begin());
      if (end != next.end() || next.empty()) return;
    }
  }

  RecordingReader reader_;
  RecordingHeader header_;
  std::uint64_t row_ = 0, contact_ = 0;
  std::vector<Sample> block_;
  std::vector<ContactSample> contacts_;
};

class Hdf5Sink final : public RecordingSink {
 public:
  Hdf5Sink(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
           const std::vector<StoredEvent>& events, const std::vector<ClockReading>& clocks,
           const RecordingWriter::Options& options)
      : output_(file, options.overwrite), writer_(create(output_), header, columns, replacing(options)) {
    for (const StoredEvent& event : events) writer_.append(event);
    for (const ClockReading& reading : clocks) writer_.append(reading);
  }

  void append(std::span<const Sample> samples) override { writer_.append(samples); }
  void append_contacts(std::span<const ContactSample> contacts) override { writer_.append(contacts); }
  void finish() override {
    writer_.finish();
    output_.commit();
  }

 private:
  /// Creates an empty file for the writer to replace, which keeps its permissions.
  static const std::string& create(OutputFile& output) {
    output.create();
    return output.path();
  }
  static RecordingWriter::Options replacing(RecordingWriter::Options options) {
    options.overwrite = true;
    return options;
  }

  OutputFile output_;
  RecordingWriter writer_;
};

class Cut final : public RecordingSource {
 public:
  Cut(std::unique_ptr<RecordingSource> source, double from, double to)
      : source_(std::move(source)), header_(source_->header()), from_(nanoseconds(from)), to_(nanoseconds(to)) {
    header_.uuid = new_uuid();
    source_->skip_to(from_);
    take_until_first();
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }

  [[nodiscard]] std::vector<StoredEvent> events() const override {
    const double from = 1e-9 * static_cast<double>(from_), to = 1e-9 * static_cast<double>(to_);
    std::vector<StoredEvent> events = source_->events();
    std::erase_if(events, [&](const StoredEvent& event) { return !(event.time >= from && event.time <= to); });
    for (StoredEvent& event : events) event.time = std::max(0.0, event.time - 1e-9 * static_cast<double>(start_));
    return events;
  }

  [[nodiscard]] std::vector<ClockReading> clocks() const override {
    std::vector<ClockReading> clocks = source_->clocks();
    const auto after = std::find_if(clocks.begin(), clocks.end(),
                                    [&](const ClockReading& reading) { return reading.time_ns >= start_; });
    // If no reading lies inside, move the nearest one before to the beginning, at the uncertainty of quartz over that
    // time.
    if (after != clocks.begin() && (after == clocks.end() || after->time_ns > to_)) {
      constexpr std::int64_t kQuartz = 10'000;  // one over 100 ppm
      ClockReading& before = *std::prev(after);
      const std::int64_t later = start_ - before.time_ns;
      before.time_ns += later;
      before.realtime_ns += later;
      before.monotonic_ns += later;
      before.uncertainty_ns += later / kQuartz;
    }
    std::erase_if(clocks,
                  [&](const ClockReading& reading) { return reading.time_ns < start_ || reading.time_ns > to_; });
    for (ClockReading& reading : clocks) reading.time_ns -= start_;
    return clocks;
  }

  std::span<const Sample> next() override {
    if (!first_taken_) {
      first_taken_ = true;
      return block_;
    }
    do take(source_->next());
    while (block_.empty() && !done_);
    return block_;
  }

  [[nodiscard]] std::span<const ContactSample> contacts() const override { return contacts_; }

  [[nodiscard]] double fraction() const override { return done_ ? 1 : source_->fraction(); }
  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = source_->notes();
    notes.push_back(fmt::format("time 0 is at {} s of the original", 1e-9 * static_cast<double>(start_)));
    return notes;
  }

 private:
  static constexpr double kLongest = 9.2e9;  // [s]
  static std::int64_t nanoseconds(double seconds) {
    return std::llround(std::clamp(seconds, -kLongest, kLongest) * 1e9);
  }

  void take_until_first() {
    do {
      take(source_->next());
      if (done_ && block_.empty())
        throw input_error(to_ == nanoseconds(kLongest)
                              ? fmt::format("no sample is after {} s", 1e-9 * static_cast<double>(from_))
                              : fmt::format("no sample is between {} s and {} s", 1e-9 * static_cast<double>(from_),
                                            1e-9 * static_cast<double>(to_)));
    } while (block_.empty());
  }

  /// Stops at a block that lies entirely after the end. A single stamp that jumps ahead does not stop it.
  void take(std::span<const Sample> samples) {
    block_.clear();
    contacts_.clear();
    done_ = done_ || std::all_of(samples.begin(), samples.end(), [&](const Sample& s) { return s.time_ns > to_; });
    if (done_) return;
    for (const Sample& sample : samples) {
      if (sample.time_ns < from_ || sample.time_ns > to_) continue;
      if (!started_) start_ = sample.time_ns;
      started_ = true;
      block_.push_back(sample);
      block_.back().time_ns -= start_;
    }
    for (const ContactSample& contact : source_->contacts()) {
      if (!started_ || contact.time_ns < start_ || contact.time_ns > to_) continue;
      contacts_.push_back(contact);
      contacts_.back().time_ns -= start_;
    }
  }

  std::unique_ptr<RecordingSource> source_;
  RecordingHeader header_;
  std::int64_t from_, to_, start_ = 0;
  bool first_taken_ = false, started_ = false, done_ = false;
  std::vector<Sample> block_;
  std::vector<ContactSample> contacts_;
};

class Observed final : public RecordingSource {
 public:
  Observed(std::unique_ptr<RecordingSource> source, std::function<void(std::span<const Sample>)> see)
      : source_(std::move(source)), see_(std::move(see)) {}

  [[nodiscard]] const RecordingHeader& header() const override { return source_->header(); }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return source_->events(); }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return source_->clocks(); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }
  [[nodiscard]] std::vector<std::string> notes() const override { return source_->notes(); }

  std::span<const Sample> next() override {
    const std::span<const Sample> block = source_->next();
    see_(block);
    return block;
  }
  [[nodiscard]] std::span<const ContactSample> contacts() const override { return source_->contacts(); }

 private:
  std::unique_ptr<RecordingSource> source_;
  std::function<void(std::span<const Sample>)> see_;
};

}  // namespace

std::string new_uuid() {
  return to_string(boost::uuids::random_generator()());
}

void check_order(std::span<const Sample> samples, std::optional<Sample>& before, const std::string& file) {
  for (const Sample& sample : samples) {
    if (before && sample.time_ns <= before->time_ns)
      throw input_error(fmt::format(
          "{}: time {:.9f} s comes less than 1 ns after the previous sample; a recording keeps nanoseconds. Is "
          "time in seconds? If it is, {}",
          file, 1e-9 * static_cast<double>(sample.time_ns), kResampleRemedy));
    if (before && sample.tick <= before->tick)
      throw input_error(fmt::format(
          "{}: tick {} at time {:.9f} s does not come after {} of the previous sample. Remove the ticks, and "
          "haptrace counts the samples",
          file, sample.tick, 1e-9 * static_cast<double>(sample.time_ns), before->tick));
    before = sample;
  }
}

void refuse_csv_options(const CsvOptions& options, const std::string& file, const char* format) {
  if (!options.empty())
    throw input_error(fmt::format("{}: is {}; --columns and --units are for CSV files of other programs",
                                  options.name.empty() ? file : options.name, format));
}

std::unique_ptr<RecordingSource> open_source(const std::string& file, const SourceOptions& options) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw input_error(file + ": no such file");
  if (fs::is_directory(status)) throw input_error(file + ": is a folder, not a recording");
  check(options.csv);

  std::array<char, 4> head{};
  std::ifstream(file, std::ios::binary).read(head.data(), head.size());
  const std::string_view begin(head.data(), head.size());
  const std::string name = file_ending(file);
  if (is_hdf5(file) || name == ".h5" || name == ".hdf5") {
    refuse_csv_options(options.csv, file, "a recording (HDF5)");
    return std::make_unique<Hdf5Source>(file, options.parts);
  }
  if (begin == "XDF:" || name == ".xdf") {
    refuse_csv_options(options.csv, file, "XDF, whose channels are named with --map");
    return open_xdf(file, options);
  }
  if (begin.starts_with("{") || name == ".jsonl") {
    refuse_csv_options(options.csv, file, "JSON lines");
    return open_jsonl(file, options);
  }
  return open_csv(file, options);
}

std::unique_ptr<RecordingSink> create_sink(const std::string& file, const RecordingHeader& header,
                                           const RecordingColumns& columns, const std::vector<StoredEvent>& events,
                                           const SinkOptions& options) {
  const std::string name = file_ending(file);
  if (name == ".csv" || file == kStandardOutput) return create_csv(file, header, columns, events, options);
  if (name == ".jsonl") return create_jsonl(file, header, columns, events, options);
  if (name == ".h5" || name == ".hdf5") {
    RecordingWriter::Options hdf5 = options.hdf5;
    hdf5.overwrite = options.overwrite;
    return std::make_unique<Hdf5Sink>(file, header, columns, events, options.clocks, hdf5);
  }
  throw input_error(fmt::format("{}: has no known ending; choose .h5, .csv or .jsonl", file));
}

std::unique_ptr<RecordingSource> cut(std::unique_ptr<RecordingSource> source, double from, double to) {
  if (!(from <= to)) throw input_error(fmt::format("--from {} --to {}: the end comes before the beginning", from, to));
  return std::make_unique<Cut>(std::move(source), from, to);
}

std::unique_ptr<RecordingSource> observe(std::unique_ptr<RecordingSource> source,
                                         std::function<void(std::span<const Sample>)> see) {
  return std::make_unique<Observed>(std::move(source), std::move(see));
}

std::uint64_t copy(RecordingSource& source, RecordingSink& sink, const CopyProgress& progress) {
  std::uint64_t rows = 0;
  for (std::span<const Sample> block = source.next(); !block.empty(); block = source.next()) {
    sink.append(block);
    sink.append_contacts(source.contacts());
    rows += block.size();
    if (progress.report) progress.report(source.fraction());
    if (progress.stopped && progress.stopped()) return rows;
  }
  return rows;
}

}  // namespace haptrace
