#include "formats/recording/crash_recovery.h"

#include "base/error.h"
#include "base/output_file.h"
#include "base/printable.h"
#include "base/statistics.h"
#include "base/writer_mark.h"
#include "control/event_words.h"
#include "formats/recording/hdf5_support.h"
#include "formats/recording/recording_layout.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fmt/format.h>
#include <optional>
#include <utility>

namespace haptrace {
namespace {

constexpr std::uint64_t kRecoveredBlock = 8192;  // rows, about: a whole number of checksum blocks
constexpr double kFarthest = 1000;               // [m], beyond the reach of any hand
constexpr std::size_t kMostNotes = 20;           // per file
constexpr double kTickApart = 0.5;               // ticks by which time and tick may disagree in a damaged block
constexpr double kSpreads = 10;                  // the same in median deviations, if times do not follow the rate

/// Compares bit for bit, in the columns that a file has.
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

using Damage = RecordingReader::Damage;

bool is_of(const Damage& damage, const char* column) {
  return damage.path == std::string("/samples/") + column;
}

/// Reads as much of a file as possible, in blocks, repairs it to follow the rules of a recording, and lists the rest.
class Salvage {
 public:
  explicit Salvage(RecordingReader& reader)
      : reader_(reader),
        rate_hz_(reader.header().rate_hz),
        block_rows_(std::max<std::uint64_t>(kRecoveredBlock / reader.checksum_rows(), 1) * reader.checksum_rows()) {
    reader_.on_damage([this](const Damage& damage) { here_.push_back(damage); });
  }

  /// Calls `visit(samples)` for every block in order, and `progress` with the share that is done.
  template <class Visit>
  void for_each(const Visit& visit, const std::function<void(double)>& progress) {
    unreadable_ = 0;
    previous_.reset();
    damage_.clear();
    for (std::uint64_t first = 0; first < reader_.rows(); first += block_rows_) {
      here_.clear();
      std::vector<Sample> samples = reader_.salvage(first, block_rows_);
      if (here_.empty() && !lawful(samples)) here_.push_back(unlawful(samples.size(), first));
      if (here_.empty())
        previous_ = samples.back();
      else
        samples = mended(std::move(samples), first);
      visit(samples);
      if (progress)
        progress(static_cast<double>(std::min(first + block_rows_, reader_.rows())) /
                 static_cast<double>(reader_.rows()));
    }
  }

  [[nodiscard]] std::uint64_t unreadable() const noexcept { return unreadable_; }

  struct Stretch : Damage {
    double time = 0;  ///< time of its first row [s]
  };
  /// Returns the damage; adjacent stretches are merged.
  [[nodiscard]] const std::vector<Stretch>& damage() const noexcept { return damage_; }

 private:
  /// Kinds of damage of each row of a block, as bits.
  struct Marks {
    enum : std::uint8_t { position = 1, time = 2, tick = 4, other_time = 8, other_tick = 16 };
    std::vector<std::uint8_t> rows;
    void set(const Damage& damage, std::uint64_t first, std::uint8_t mark) {
      const std::uint64_t end = std::min(damage.first + damage.count, first + rows.size());
      for (std::uint64_t row = std::max(damage.first, first); row < end; ++row) rows[row - first] |= mark;
    }
  };

  /// Returns true if a block without known damage follows the rules. Files without checksums offer no other test.
  [[nodiscard]] bool lawful(const std::vector<Sample>& samples) const {
    const Sample* before = previous_ ? &*previous_ : nullptr;
    return std::all_of(samples.begin(), samples.end(), [&](const Sample& sample) {
      const bool follows_it = before == nullptr || follows(sample, *before);
      before = &sample;
      return follows_it && sample.position.allFinite() && is_time(sample) && std::isfinite(sample.latency) &&
             static_cast<unsigned>(sample.phase) <= static_cast<unsigned>(Phase::stopped);
    });
  }

  [[nodiscard]] Damage unlawful(std::size_t count, std::uint64_t first) const {
    return {reader_.files().front(), "/samples/time", first, count, "holds impossible values"};
  }

  static bool is_time(const Sample& sample) {
    return std::abs(static_cast<double>(sample.time_ns)) <= 1e9 * layout::kLongestTime;
  }

  std::vector<Sample> mended(std::vector<Sample> samples, std::uint64_t first) {
    Marks marks{std::vector<std::uint8_t>(samples.size())}, force = marks;
    for (const Damage& damage : here_) {
      if (is_of(damage, "position") && !damage.readable) marks.set(damage, first, Marks::position);
      if (is_of(damage, "time")) marks.set(damage, first, damage.readable ? Marks::other_time : Marks::time);
      if (is_of(damage, "tick")) marks.set(damage, first, damage.readable ? Marks::other_tick : Marks::tick);
      if (is_of(damage, "force") && !damage.readable) force.set(damage, first, 1);
    }
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (force.rows[i] != 0) samples[i].force = nan3();
    mend_times(samples, marks.rows);

    std::vector<Sample> kept;
    std::vector<std::uint8_t> doubtful;  // for each kept row: its time or tick was damaged
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const bool doubt = (marks.rows[i] & ~Marks::position) != 0;
      if ((marks.rows[i] & Marks::position) != 0 || !(samples[i].position.cwiseAbs().maxCoeff() < kFarthest) ||
          !is_time(samples[i])) {
        ++unreadable_;
        continue;
      }
      // If two rows are out of order, drop the one whose time or tick was damaged.
      while (!doubt && !kept.empty() && doubtful.back() != 0 && !follows(samples[i], kept.back())) {
        kept.pop_back();
        doubtful.pop_back();
        ++unreadable_;
      }
      const Sample* const before = !kept.empty() ? &kept.back() : previous_ ? &*previous_ : nullptr;
      if (before != nullptr && !follows(samples[i], *before)) {
        ++unreadable_;
        continue;
      }
      kept.push_back(samples[i]);
      doubtful.push_back(doubt ? 1 : 0);
    }
    for (const Damage& damage : here_) add(damage, samples, first);
    for (Sample& sample : kept) {
      make_lawful(sample);
      previous_ = sample;
    }
    return kept;
  }

  static bool follows(const Sample& sample, const Sample& before) {
    return sample.tick > before.tick && sample.time_ns > before.time_ns;
  }

  /// Returns how far the grid of the rate is ahead of a row's tick [ticks]. A tick wakes on the grid, later by its
  /// latency.
  [[nodiscard]] double ahead(const Sample& sample) const {
    const double late = std::isfinite(sample.latency) ? static_cast<double>(sample.latency) : 0;
    return (1e-9 * static_cast<double>(sample.time_ns) - late) * rate_hz_ - static_cast<double>(sample.tick);
  }

  /// Computes times from ticks, and ticks from times, that cannot be read or contradict each other in a damaged block.
  void mend_times(std::vector<Sample>& samples, std::vector<std::uint8_t>& marks) const {
    if (!(rate_hz_ > 0)) return;
    std::vector<double> known;
    for (std::size_t i = 0; i < samples.size(); ++i)
      if ((marks[i] & (Marks::time | Marks::tick)) == 0) known.push_back(ahead(samples[i]));
    if (known.empty() && previous_) known.push_back(ahead(*previous_));
    if (known.empty()) known.push_back(0);
    const double middle = median(known);
    for (double& value : known) value = std::abs(value - middle);
    const double most = std::max(kTickApart, kSpreads * median(known));
    for (std::size_t i = 0; i < samples.size(); ++i) {
      Sample& sample = samples[i];
      const bool apart = std::abs(ahead(sample) - middle) > most;
      const double late = std::isfinite(sample.latency) ? static_cast<double>(sample.latency) : 0;
      const bool no_time = (marks[i] & Marks::time) != 0, no_tick = (marks[i] & Marks::tick) != 0;
      if (no_time && no_tick)
        marks[i] |= Marks::position;
      else if (no_time || (apart && (marks[i] & Marks::other_time) != 0))
        sample.time_ns = std::llround(1e9 * ((static_cast<double>(sample.tick) + middle) / rate_hz_ + late));
      else if (no_tick || (apart && (marks[i] & Marks::other_tick) != 0))
        sample.tick = static_cast<std::uint64_t>(
            std::max(0.0, std::round((1e-9 * static_cast<double>(sample.time_ns) - late) * rate_hz_ - middle)));
    }
  }

  /// Replaces invalid values: a damaged block may contain any bits.
  void make_lawful(Sample& sample) const {
    for (Vec3 Sample::*member :
         {&Sample::velocity, &Sample::force, &Sample::torque, &Sample::force_measured, &Sample::support,
          &Sample::reference_position, &Sample::reference_velocity, &Sample::reference_force, &Sample::kp, &Sample::kd})
      if (!(sample.*member).allFinite()) sample.*member = nan3();
    for (Quat Sample::*member : {&Sample::orientation, &Sample::reference_orientation})
      if (!(std::abs((sample.*member).norm() - 1) < 1e-3)) sample.*member = nan_quat();
    for (double Sample::*member : {&Sample::progress, &Sample::tunnel_radius})
      if (!std::isfinite(sample.*member)) sample.*member = kNaN;
    if (const double most = reader_.header().max_force_n; most > 0 && sample.force.norm() > most) sample.force = nan3();
    if (!(sample.latency >= 0 && std::isfinite(sample.latency))) sample.latency = 0;
    if (static_cast<unsigned>(sample.phase) > static_cast<unsigned>(Phase::stopped))
      sample.phase = previous_ ? previous_->phase : Phase::idle;
  }

  void add(const Damage& damage, const std::vector<Sample>& samples, std::uint64_t first) {
    const auto same = std::find_if(damage_.rbegin(), damage_.rend(), [&](const Stretch& known) {
      return known.path == damage.path && known.readable == damage.readable &&
             known.first + known.count == damage.first;
    });
    if (same != damage_.rend()) {
      same->count += damage.count;
      return;
    }
    const Sample& near = samples[std::min<std::uint64_t>(std::max(damage.first, first) - first, samples.size() - 1)];
    damage_.push_back({damage, is_time(near) ? 1e-9 * static_cast<double>(near.time_ns) : 0});
  }

  RecordingReader& reader_;
  double rate_hz_;
  std::uint64_t block_rows_;
  std::vector<Damage> here_;  ///< damage in the present block
  std::vector<Stretch> damage_;
  std::optional<Sample> previous_;
  std::uint64_t unreadable_ = 0;
};

std::string words_of(const Salvage::Stretch& damage) {
  return fmt::format(
      "{} {} in rows {} to {}", damage.path,
      damage.readable ? "holds values that differ from the recorded ones and were kept," : "cannot be read",
      damage.first, damage.first + damage.count - 1);
}

void append_event(RecordingWriter& writer, double time, EventCode code, const std::string& text) {
  writer.append(StoredEvent{.time = time, .code = static_cast<int>(code), .text = text});
}

/// Copies all readable data of a file into an empty one, and notes what is lost.
class PartCopy {
 public:
  PartCopy(RecordingReader& reader, const std::string& name, const std::string& copy,
           const std::function<void(double)>& progress, Recovery& recovery)
      : reader_(reader),
        name_(name),
        copy_(copy),
        progress_(progress),
        recovery_(recovery),
        salvage_(reader),
        writer_(copy, reader.header(), reader.columns(),
                {.overwrite = true, .storage = {.deflate = reader.deflate()}, .keep_part = true}) {}

  void run() {
    for (const std::string& lost : reader_.lost()) note(lost);
    for (const std::string& path : reader_.foreign())
      note(fmt::format("{}: {} belongs to another program and is not copied", name_, path));
    copy_samples();
    copy_events();
    copy_contacts();
    copy_clocks();
    append_damage();
    const Event recovered{
        .code = EventCode::recovered,
        .values = {static_cast<double>(writer_.rows()), static_cast<double>(salvage_.unreadable()), kNaN}};
    append_event(writer_, end_, recovered.code, describe(recovered));
    writer_.finish();
    recovery_.samples += verified_rows();
    recovery_.unreadable += salvage_.unreadable();
  }

 private:
  void note(std::string text) { recovery_.notes.push_back(std::move(text)); }

  void note_damage(std::string text) {
    note(std::move(text));
    recovery_.damaged = true;
  }

  /// Returns the progress of one half of the work, which begins at `begin`.
  [[nodiscard]] std::function<void(double)> half(double begin) const {
    return [this, begin](double done) {
      if (progress_) progress_(begin + 0.5 * done);
    };
  }

  void copy_samples() {
    salvage_.for_each(
        [&](const std::vector<Sample>& samples) {
          writer_.append(samples);
          if (!samples.empty()) end_ = 1e-9 * static_cast<double>(samples.back().time_ns);
        },
        half(0));
  }

  void copy_events() {
    reader_.on_damage([&](const Damage& damage) {
      note(fmt::format("{}: {} {}", name_, damage.path, damage.what));
      events_changed_ = true;
    });
    try {
      std::size_t no_events = 0;
      for (StoredEvent event : reader_.events()) {
        if (!std::isfinite(event.time) || event.code <= 0) {
          ++no_events;
          continue;
        }
        if (events_changed_) event.text = printable(event.text);
        writer_.append(event);
      }
      if (no_events > 0) note_damage(fmt::format("{}: {} events are lost", name_, no_events));
    } catch (const Error& error) {
      note_damage(fmt::format("the events are lost: {}", error.what()));
    }
  }

  void copy_contacts() {
    try {
      constexpr std::uint64_t kBlock = 8192;
      for (std::uint64_t first = 0; first < reader_.contact_rows(); first += kBlock)
        writer_.append(std::span<const ContactSample>(reader_.contacts(first, kBlock)));
      reader_.verify_contacts();
    } catch (const Error& error) {
      note_damage(fmt::format("contacts are lost: {}", error.what()));
    }
  }

  void copy_clocks() {
    reader_.on_damage([&](const Damage& damage) {
      note_damage(fmt::format("{}: {}[{}] is lost: it {}", name_, damage.path, damage.first, damage.what));
    });
    try {
      for (const ClockReading& reading : reader_.clocks()) writer_.append(reading);
    } catch (const Error& error) {
      note_damage(fmt::format("the readings of the clocks are lost: {}", error.what()));
    }
  }

  /// Appends an event for each damaged range, up to kMostNotes.
  void append_damage() {
    if (events_changed_)
      append_event(writer_, end_, EventCode::values_lost,
                   "the events hold times or texts that differ from the recorded ones");
    const std::vector<Salvage::Stretch>& damage = salvage_.damage();
    recovery_.damaged = recovery_.damaged || events_changed_ || !damage.empty() || !reader_.lost().empty();
    for (std::size_t i = 0; i < std::min<std::size_t>(damage.size(), kMostNotes); ++i) {
      append_event(writer_, damage[i].time, EventCode::values_lost, words_of(damage[i]));
      note(fmt::format("{}: {}", name_, words_of(damage[i])));
    }
    if (damage.size() <= kMostNotes) return;
    const std::string rest = fmt::format("{} further ranges are damaged", damage.size() - kMostNotes);
    append_event(writer_, end_, EventCode::values_lost, rest);
    note(fmt::format("{}: {}", name_, rest));
  }

  /// Returns the number of rows, all of which read back as they were written. Throws Error(input) otherwise.
  [[nodiscard]] std::uint64_t verified_rows() {
    const RecordingReader written(copy_, RecordingReader::Parts::this_file);
    std::uint64_t row = 0;
    Salvage again(reader_);
    again.for_each(
        [&](const std::vector<Sample>& samples) {
          if (!same(samples, written.read(row, samples.size()), reader_.columns()))
            throw input_error(
                fmt::format("{}: the data read back differ from the data written; is the disk broken?", copy_));
          row += samples.size();
        },
        half(0.5));
    if (row != written.rows())
      throw input_error(fmt::format("{}: has {} rows instead of {}", copy_, written.rows(), row));
    return row;
  }

  RecordingReader& reader_;
  const std::string &name_, &copy_;  ///< the names of both files
  const std::function<void(double)>& progress_;
  Recovery& recovery_;
  Salvage salvage_;
  RecordingWriter writer_;
  double end_ = 0;               ///< time of the last sample [s]
  bool events_changed_ = false;  ///< the events differ from the recorded ones
};

/// Writes all readable data of `reader` into the empty file `copy`, and verifies the file.
void copy_part(RecordingReader& reader, const std::string& name, const std::string& copy,
               const std::function<void(double)>& progress, Recovery& recovery) {
  PartCopy(reader, name, copy, progress, recovery).run();
}

bool is_whole(RecordingReader& reader, const std::string& file) {
  if (!reader.lost().empty() || !reader.header().complete || hdf5::was_left_open(file)) return false;
  bool damaged = false;
  Salvage salvage(reader);
  salvage.for_each([](const auto&) {}, {});
  reader.on_damage([&](const Damage&) { damaged = true; });
  try {
    (void)reader.events();
    (void)reader.clocks();
    reader.verify_contacts();
    (void)reader.overview();
  } catch (const Error&) {
    return false;
  }
  return !damaged && salvage.damage().empty();
}

}  // namespace

Recovery recover_recording(const std::string& file, const std::string& output, bool overwrite,
                           const std::function<void(double)>& progress) {
  const RecordingReader all = RecordingReader::for_salvage(file, RecordingReader::Parts::present);
  const std::vector<std::string> files = all.files();
  for (const std::string& source : files)
    if (has_writer(source))
      throw input_error(fmt::format("{}: is being written by a running session; end the session first", source));

  Recovery recovery;
  for (const std::string& missing : all.missing_parts())
    recovery.notes.push_back(fmt::format("{}, a part of this recording, is missing or cannot be read", missing));
  recovery.damaged = !all.missing_parts().empty();
  for (std::size_t part = 0; part < files.size(); ++part) {
    const std::string& source = files[part];
    RecordingReader reader = RecordingReader::for_salvage(source);
    if (output.empty() && is_whole(reader, source)) {
      recovery.samples += reader.rows();
      continue;
    }
    recovery.needed = true;
    const std::string restored = output.empty() ? source : part_file(output, part == 0 ? 1 : reader.header().part);
    OutputFile target(restored, output.empty() || overwrite);
    target.create();
    std::filesystem::permissions(target.path(), std::filesystem::status(source).permissions());
    copy_part(
        reader, source, target.path(),
        [&](double done) {
          if (progress) progress((static_cast<double>(part) + done) / static_cast<double>(files.size()));
        },
        recovery);
    target.commit();
    recovery.files.push_back(restored);
  }
  return recovery;
}

}  // namespace haptrace
