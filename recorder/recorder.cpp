#include "recorder/recorder.h"

#include "base/disk_space.h"
#include "base/error.h"
#include "base/number.h"
#include "base/stopwatch.h"
#include "base/text_file.h"
#include "base/units.h"
#include "formats/documents/warning_json.h"
#include "recorder/annotations.h"
#include "recorder/capture.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <chrono>
#include <cmath>
#include <ctime>
#include <exception>
#include <fmt/format.h>
#include <limits>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kSmallestRing = 16384;  // rows; in virtual time the loop runs far ahead of the writer
constexpr double kChunkSpan = 2;  // longest session time in a chunk, so that slow sessions make small files [s]
constexpr std::size_t kLargestChunk = 2048;  // rows
constexpr std::size_t kSmallestPacked = 32;  // rows of a chunk below which packing makes a file larger
constexpr std::size_t kLargestBatch = 1024;  // rows
// Time between two polls of the ring. Waking up costs more than the work itself, and at real speed the ring holds
// seconds.
constexpr auto kPoll = std::chrono::milliseconds(25), kPollInVirtualTime = std::chrono::milliseconds(5);
// A session in virtual time makes more rows in a flush period than people expect to lose.
constexpr std::uint64_t kMostUnflushed = 4096;                            // rows
constexpr std::size_t kContactsPerTick = 2, kMostContactsOfATick = 1024;  // that the ring has room for
constexpr double kRestPerFlush = 4;
constexpr auto kRetry = std::chrono::milliseconds(50);  // time between two attempts on a disk that refuses
constexpr double kVirtualPatience = 2;                  // time for such attempts if the session waits for the disk [s]
constexpr std::size_t kSplitStep = 256;                 // rows between two checks of the file's size
constexpr double kClockPeriod = 60;                     // time between two readings of the clocks [s]
constexpr double kShortestDrift = 1;  // longer recordings read the clocks at their end as well, to show their drift [s]
constexpr int kClockReadings = 16;    // readings, of which the most certain is kept
constexpr double kLookAround = 1;     // time between two checks of the file and its disk [s]
constexpr std::array<double, 2> kDiskWarnings{600, 60};  // warn when the disk has room for no more than this [s]
constexpr std::uint64_t kDiskFloor = 64U << 20U;         // free space below which the session should end [bytes]

std::size_t rows_in(double seconds, double rate_hz, std::size_t least) {
  return std::max(least, static_cast<std::size_t>(std::ceil(seconds * rate_hz)));
}

std::int64_t read_clock(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return std::int64_t{1'000'000'000} * now.tv_sec + now.tv_nsec;
}

/// Reads the clocks as simultaneously as possible. Leaves the time of the recording open.
ClockReading read_clocks() {
  ClockReading best{.uncertainty_ns = std::numeric_limits<std::int64_t>::max()};
  for (int i = 0; i < kClockReadings; ++i) {
    const std::int64_t before = read_clock(CLOCK_MONOTONIC), wall = read_clock(CLOCK_REALTIME),
                       after = read_clock(CLOCK_MONOTONIC);
    if (after - before < best.uncertainty_ns)
      best = {.realtime_ns = wall, .monotonic_ns = before + (after - before) / 2, .uncertainty_ns = after - before};
  }
  return best;
}

RecordingWriter::Options writer_options(const RecorderOptions& options, double rate_hz) {
  RecordingWriter::Options result{
      .overwrite = options.overwrite, .storage = options.storage, .in_parts = options.split.any()};
  // Packed chunks are written when they are full, so they hold one flush period. Other chunks may have any size.
  const std::size_t packed = rows_in(options.flush_period, rate_hz, 1);
  if (options.storage.filtered() && packed < kSmallestPacked)
    throw input_error(fmt::format(
        "at {:g} Hz a recording cannot be compressed while it grows: a compressed chunk of {} samples would be larger "
        "than the samples. Record without compression, and use haptrace convert --compress afterwards",
        rate_hz, packed));
  result.storage.rows_per_chunk =
      options.storage.filtered() ? packed : std::min(rows_in(kChunkSpan, rate_hz, 64), kLargestChunk);
  return result;
}

void check(const RecorderOptions& options) {
  validate(options.storage);
  validate(options.capture);
  if (!(options.sync_period >= 0 && options.sync_period <= 3600))
    throw input_error(
        fmt::format("the period of --sync is {} s; it must be from 0 (never) to 3600 s", options.sync_period));
}

}  // namespace

Split parse_split(std::string_view text) {
  struct SizeUnit {
    std::string_view name;
    double bytes;
  };
  static constexpr std::array<SizeUnit, 6> kSizeUnits{
      {{"MB", 1e6}, {"GB", 1e9}, {"TB", 1e12}, {"MiB", 0x1p20}, {"GiB", 0x1p30}, {"TiB", 0x1p40}}};
  std::string_view suffix = trim(text);
  const auto number = take_number<double>(suffix);
  suffix = trim(suffix);
  // A number alone may be a time or a size.
  if (const auto seconds = parse_quantity(trim(text), "s");
      seconds && !suffix.empty() && *seconds >= 1 && *seconds <= 1e7)
    return {.seconds = *seconds};
  for (const SizeUnit& unit : kSizeUnits) {
    if (!number || suffix != unit.name) continue;
    const double bytes = *number * unit.bytes;
    if (bytes >= 1e6 && bytes <= 0x1p50) return {.bytes = static_cast<std::uint64_t>(bytes)};
  }
  throw input_error(
      fmt::format("split '{}' is neither a time from 1 s (s, min, h) nor a size from 1 MB (MB, GB, TB, MiB, GiB, TiB); "
                  "write, for example, 30min or 1GiB",
                  text));
}

/// The writer thread, and the state that it shares with other threads.
class Recorder::Writer final : private Capture::Output {
 public:
  Writer(const std::string& name, const RecordingHeader& header, const RecordingColumns& columns,
         const RecorderOptions& options)
      : file(name),
        samples(rows_in(options.ring_seconds, header.rate_hz, kSmallestRing)),
        events(rows_in(options.ring_seconds, header.rate_hz, kSmallestRing)),
        options_(options),
        bytes_per_second_(static_cast<double>(row_bytes(columns)) * header.rate_hz),
        loop_waits_(header.clock == "virtual"),
        output_(name, header, columns, writer_options(options, header.rate_hz)),
        capture_(options.capture, *this) {
    if (columns.contacts)
      contacts.emplace(kContactsPerTick * rows_in(options.ring_seconds, header.rate_hz, kSmallestRing));
    look_at_disk();
    if (const double seconds = disk_seconds_.load(); options.tell_room && seconds > 0 && warnings_told_ == 0)
      warn(Severity::note, "disk_space",
           fmt::format("{}: the disk has room for {}", output_.part(), long_duration_text(seconds)));
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

  void start(std::int64_t monotonic_ns) noexcept { start_ns_.store(monotonic_ns, std::memory_order_release); }

  void push(const Sample& sample) noexcept {
    if (options_.annotations) options_.annotations->tick(sample.time_ns);
    if (!samples.push(sample)) lose();
  }

  void push(const Event& event) noexcept {
    if (!events.push(event)) lose();
  }

  void push_contact(const ContactSample& contact) noexcept {
    if (contacts && !contacts->push(contact)) lose();
  }

  void lose() noexcept { lost_.fetch_add(1, std::memory_order_relaxed); }

  void wait_for_room() noexcept {
    while ((samples.write_available() == 0 || (contacts && contacts->write_available() < kMostContactsOfATick)) &&
           !failed_.load(std::memory_order_acquire))
      std::this_thread::sleep_for(std::chrono::microseconds(100));
  }

  void stop() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
  }

  void finish(const nlohmann::json& warnings) {
    stop();
    if (error_) {
      output_.abandon();
      lost_.fetch_add(samples.read_available(), std::memory_order_relaxed);
      std::rethrow_exception(std::exchange(error_, nullptr));
    }
    const auto end = [&](const nlohmann::json& all) {
      output_.warn(all);
      output_.finish();
    };
    try {
      end(warnings);
    } catch (const Error& error) {
      interrupt(error);
      if (!resumed()) {
        count_failure();
        throw;
      }
      nlohmann::json all = warnings;
      for (const nlohmann::json& late : json_of(warnings_)) all.push_back(late);
      end(all);
    }
    written_.store(output_.rows(), std::memory_order_relaxed);
  }

  void abandon() noexcept {
    stop();
    output_.abandon();
    written_.store(output_.rows(), std::memory_order_relaxed);
  }

  [[nodiscard]] RecorderStatus status() const noexcept {
    RecorderStatus status{.written = written_.load(std::memory_order_relaxed),
                          .lost = lost_.load(std::memory_order_relaxed),
                          .interrupted = interrupted_.load(std::memory_order_relaxed),
                          .failed = failed_.load(std::memory_order_acquire),
                          .armed = armed_.load(std::memory_order_relaxed),
                          .paused = paused_.load(std::memory_order_relaxed),
                          .disk_low = disk_low_.load(std::memory_order_relaxed),
                          .parts = parts_.load(std::memory_order_relaxed),
                          .disk_seconds = disk_seconds_.load(std::memory_order_relaxed)};
    if (!status.failed && thread_.joinable())
      status.stalled =
          seconds_between(Clock::time_point(Clock::duration(alive_.load(std::memory_order_relaxed))), Clock::now());
    return status;
  }

  std::vector<Warning> take_warnings() {
    const std::lock_guard lock(warnings_mutex_);
    return std::exchange(warnings_, {});
  }

  const std::string file;
  boost::lockfree::spsc_queue<Sample> samples;
  boost::lockfree::spsc_queue<Event> events;
  std::optional<boost::lockfree::spsc_queue<ContactSample>> contacts;

 private:
  /// Runs until a stop is requested and the rings are empty.
  void run(const std::stop_token& stop) noexcept {
    try {
      auto flushed = Clock::now(), synced = flushed, looked = flushed;
      double cost = 0;  // duration of the last flush [s]
      std::uint64_t flushed_rows = 0;
      for (bool last = false; !last;) {
        const bool stopping = stop.stop_requested();
        const auto begun = Clock::now();
        alive_.store(begun.time_since_epoch().count(), std::memory_order_relaxed);
        if (interrupted_.load(std::memory_order_relaxed) && !resumed()) {
          // The ring keeps the new samples.
          if (stopping || (loop_waits_ && seconds_between(refused_since_, begun) > kVirtualPatience))
            throw Error(Error::Kind::fault, refusal_);
          std::this_thread::sleep_for(kRetry);
          continue;
        }
        const bool wrote = drain();
        last = stopping && !wrote;
        const auto now = Clock::now();
        alive_.store(now.time_since_epoch().count(), std::memory_order_relaxed);
        const double rest = rest_after(cost);
        const bool sync =
            options_.sync_period > 0 && seconds_between(synced, now) >= std::max(options_.sync_period, rest);
        if (sync || seconds_between(flushed, now) >= std::max(options_.flush_period, rest) ||
            (loop_waits_ && appended_ - flushed_rows >= kMostUnflushed)) {
          on_disk([&] { output_.flush(); });
          flushed_rows = appended_;
          // If the sync fails, a further part could not keep its promise either: let the recording fail.
          if (sync && !interrupted_.load(std::memory_order_relaxed)) output_.sync();
          flushed = Clock::now();
          if (sync) synced = flushed;
          cost = seconds_between(now, flushed);
          look_at_disk();
        }
        if (seconds_between(looked, now) >= kLookAround) {
          look_at_file();
          looked = now;
        }
        if (!last && !(wrote && (loop_waits_ || stopping || samples.read_available() >= kLargestBatch)))
          std::this_thread::sleep_for(loop_waits_ ? kPollInVirtualTime : kPoll);
      }
      capture_.finish();
      on_disk([&] { read_last_clocks(); });
      if (interrupted_.load(std::memory_order_relaxed) && !resumed()) throw Error(Error::Kind::fault, refusal_);
      if (capture_.armed())
        warn(Severity::warning, "no_trigger", file + ": the trigger did not fire; nothing was recorded");
    } catch (const std::exception& error) {
      warn(Severity::problem, "recording_failed",
           std::string(error.what()) + "; the session continues without the recording");
      error_ = std::current_exception();
      count_failure();
    }
  }

  /// Counts all samples that the files do not contain as lost.
  void count_failure() {
    const std::uint64_t written = output_.rows();
    written_.store(written, std::memory_order_relaxed);
    lost_.fetch_add(appended_ - std::min(appended_, written + missing_), std::memory_order_relaxed);
    interrupted_.store(false, std::memory_order_relaxed);
    failed_.store(true, std::memory_order_release);
  }

  /// Runs an action that writes. If the disk refuses, interrupts the recording; the data waits.
  template <class Action>
  void on_disk(const Action& action) {
    if (interrupted_.load(std::memory_order_relaxed)) return;
    try {
      action();
    } catch (const Error& error) {
      interrupt(error);
    }
  }

  void interrupt(const Error& error) {
    refusal_ = error.what();
    refused_since_ = Clock::now();
    warn(Severity::warning, "recording_interrupted", refusal_ + "; the recorder tries to continue in a further file");
    interrupted_.store(true, std::memory_order_relaxed);
  }

  /// Tries to continue the recording in a further part. Returns true on success.
  bool resumed() {
    std::uint64_t missing = 0;
    try {
      missing = output_.resume();
    } catch (const Error&) {
      return false;
    }
    interrupted_.store(false, std::memory_order_relaxed);
    parts_.fetch_add(1, std::memory_order_relaxed);
    lost_.fetch_add(missing, std::memory_order_relaxed);
    missing_ += missing;
    lost_told_ += missing;  // reported here, not as a loss of the ring
    part_begin_ns_ = last_time_ns_;
    const Event resumed{.time_ns = last_time_ns_,
                        .code = EventCode::recording_resumed,
                        .values = {seconds_between(refused_since_, Clock::now()), static_cast<double>(missing), kNaN}};
    warn(Severity::warning, "recording_resumed", fmt::format("{}: {}", output_.part(), describe(resumed)));
    append(StoredEvent{.time = 1e-9 * static_cast<double>(resumed.time_ns),
                       .code = static_cast<int>(resumed.code),
                       .text = describe(resumed)});
    for (const StoredEvent& event : std::exchange(waiting_events_, {})) append(event);
    put(std::exchange(waiting_, {}), std::exchange(waiting_contacts_, {}));
    on_disk([&] { read_clocks_at(std::nullopt); });
    written_.store(output_.rows(), std::memory_order_relaxed);
    return !interrupted_.load(std::memory_order_relaxed);
  }

  /// Returns how long to leave the file alone after a flush of this cost [s]. If samples wait because the disk is slow,
  /// catching up comes before flushing.
  [[nodiscard]] double rest_after(double cost) const {
    return !loop_waits_ && samples.read_available() >= kLargestBatch ? kRestPerFlush * cost : 0;
  }

  /// Returns true if there was anything to write.
  bool drain() {
    // Take the samples first: an event is pushed before the sample of its tick, so all events of these samples are
    // there.
    while (batch_.size() < kLargestBatch &&
           samples.consume_one([&](const Sample& sample) { batch_.push_back(sample); })) {
    }
    std::vector<ContactSample> touched;
    if (contacts) contacts->consume_all([&](const ContactSample& contact) { touched.push_back(contact); });
    std::vector<TimedEvent> happened;
    events.consume_all([&](const Event& event) { happened.push_back({event.time_ns, event.code, describe(event)}); });
    if (options_.annotations) {
      std::vector<TimedEvent> said = options_.annotations->take();
      happened.insert(happened.end(), std::make_move_iterator(said.begin()), std::make_move_iterator(said.end()));
    }
    if (!batch_.empty()) last_time_ns_ = batch_.back().time_ns;
    tell_losses(happened);
    if (batch_.empty() && happened.empty() && touched.empty()) return false;
    capture_.feed(batch_, std::move(happened), touched);
    batch_.clear();
    armed_.store(capture_.armed(), std::memory_order_relaxed);
    paused_.store(capture_.paused(), std::memory_order_relaxed);
    return true;
  }

  void tell_losses(std::vector<TimedEvent>& happened) {
    const std::uint64_t lost = lost_.load(std::memory_order_relaxed);
    if (lost == lost_told_) return;
    const Event event{.time_ns = last_time_ns_,
                      .code = EventCode::samples_lost,
                      .values = {static_cast<double>(lost - lost_told_), kNaN, kNaN}};
    happened.push_back({event.time_ns, event.code, describe(event)});
    lost_told_ = lost;
  }

  void append(std::span<const Sample> kept, std::span<const ContactSample> touched) override {
    appended_ += kept.size();
    put(kept, touched);
  }

  void put(std::span<const Sample> kept, std::span<const ContactSample> touched) {
    on_disk([&] {
      if (!kept.empty()) read_due_clocks(kept.front().time_ns);
      while (!kept.empty()) {
        const std::size_t count = rows_of_this_part(kept);
        const std::span<const Sample> here = kept.first(count);
        if (count == 0) {
          start_part(kept.front().time_ns);
          continue;
        }
        kept = kept.subspan(count);  // the writer keeps these, even if the disk refuses
        output_.append(here);
        const auto end = std::find_if(touched.begin(), touched.end(),
                                      [&](const ContactSample& contact) { return contact.tick > here.back().tick; });
        const std::span<const ContactSample> of_here(touched.begin(), end);
        touched = touched.subspan(of_here.size());
        output_.append(of_here);
        written_.store(output_.rows(), std::memory_order_relaxed);
      }
    });
    waiting_.insert(waiting_.end(), kept.begin(), kept.end());
    waiting_contacts_.insert(waiting_contacts_.end(), touched.begin(), touched.end());
  }

  /// Returns how many of these rows the current part takes at once; 0: it is full.
  [[nodiscard]] std::size_t rows_of_this_part(std::span<const Sample> rows) const {
    std::size_t count = rows.size();
    if (const auto span_ns = std::llround(1e9 * options_.split.seconds); span_ns > 0) {
      const auto next = std::find_if(rows.begin(), rows.end(),
                                     [&](const Sample& s) { return s.time_ns - part_begin_ns_ >= span_ns; });
      count = static_cast<std::size_t>(next - rows.begin());
    }
    if (options_.split.bytes == 0) return count;
    count = std::min(count, kSplitStep);
    return output_.part_rows() > 0 && output_.part_bytes(count) > options_.split.bytes ? 0 : count;
  }

  void append(const StoredEvent& event) override {
    bool waits = interrupted_.load(std::memory_order_relaxed);
    on_disk([&] { output_.append(event); });
    if (waits) waiting_events_.push_back(event);
  }

  void start_part(std::int64_t begin_ns) {
    output_.start_part();
    read_clocks_at(std::nullopt);  // so that each part can be aligned by itself
    part_begin_ns_ = begin_ns;
    parts_.fetch_add(1, std::memory_order_relaxed);
  }

  /// Reads the clocks at the first row and every kClockPeriod.
  void read_due_clocks(std::int64_t row_ns) {
    if (!clocks_read_)
      read_clocks_at(row_ns);
    else if (row_ns - clocks_read_ns_ >= std::llround(1e9 * kClockPeriod))
      read_clocks_at(std::nullopt);
  }

  void read_last_clocks() {
    if (clocks_read_ && last_time_ns_ - clocks_read_ns_ >= std::llround(1e9 * kShortestDrift))
      read_clocks_at(std::nullopt);
  }

  /// Stores a reading of the clocks, for now or for a recent time of the session.
  void read_clocks_at(std::optional<std::int64_t> time_ns) {
    const std::int64_t start_ns = start_ns_.load(std::memory_order_acquire);
    if (start_ns == kNoStart) return;  // virtual time is unrelated to the computer's clocks
    ClockReading reading = read_clocks();
    reading.time_ns = reading.monotonic_ns - start_ns;
    if (time_ns) {
      const std::int64_t back = reading.time_ns - *time_ns;
      reading.time_ns -= back;
      reading.monotonic_ns -= back;
      reading.realtime_ns -= back;
    }
    if (clocks_read_ && reading.time_ns <= clocks_read_ns_) return;
    output_.append(reading);
    clocks_read_ = true;
    clocks_read_ns_ = reading.time_ns;
  }

  void look_at_file() {
    const std::string misplaced = output_.misplaced();
    if (!misplaced.empty() && misplaced != misplaced_told_) warn(Severity::warning, "file_moved", misplaced);
    misplaced_told_ = misplaced;
  }

  void look_at_disk() {
    const DiskSpace space = disk_space(output_.part());
    if (space.total == 0) return;
    const double seconds = static_cast<double>(space.free) / bytes_per_second_;
    disk_seconds_.store(seconds, std::memory_order_relaxed);
    const std::size_t told_before = warnings_told_;
    while (warnings_told_ < kDiskWarnings.size() && seconds <= kDiskWarnings[warnings_told_]) ++warnings_told_;
    if (warnings_told_ > told_before)
      warn(Severity::warning, "disk_space",
           fmt::format("{}: the disk has room for {} more", output_.part(), long_duration_text(seconds)));
    if (disk_low_.load(std::memory_order_relaxed) || space.free > std::min(kDiskFloor, space.total / 100)) return;
    warn(Severity::warning, "disk_space",
         fmt::format("{}: the disk is almost full, {:.1f} MB are left; end the session or make room", output_.part(),
                     1e-6 * static_cast<double>(space.free)));
    disk_low_.store(true, std::memory_order_relaxed);
  }

  void warn(Severity severity, const char* code, std::string text) noexcept {
    const std::lock_guard lock(warnings_mutex_);
    warnings_.push_back({severity, code, kNaN, std::move(text)});
  }

  const RecorderOptions options_;
  const double bytes_per_second_;  ///< per second of the session
  const bool loop_waits_;          ///< in virtual time the loop can wait for the disk, see between_ticks
  std::atomic<std::uint64_t> written_{0}, lost_{0};
  std::atomic<std::uint32_t> parts_{1};
  static constexpr std::int64_t kNoStart = std::numeric_limits<std::int64_t>::min();
  std::atomic<std::int64_t> start_ns_{kNoStart};  ///< start of the session, on CLOCK_MONOTONIC
  std::atomic<bool> failed_{false}, interrupted_{false}, armed_{false}, paused_{false}, disk_low_{false};
  std::atomic<double> disk_seconds_{0};
  std::atomic<Clock::rep> alive_{Clock::now().time_since_epoch().count()};
  std::mutex warnings_mutex_;
  std::vector<Warning> warnings_;

  // Used by the writer thread only.
  RecordingWriter output_;
  Capture capture_;
  std::vector<Sample> batch_;
  std::uint64_t lost_told_ = 0;
  std::int64_t last_time_ns_ = 0, part_begin_ns_ = 0;
  std::string misplaced_told_;
  std::size_t warnings_told_ = 0;
  std::exception_ptr error_;                  ///< read after join
  std::uint64_t appended_ = 0, missing_ = 0;  ///< rows passed to the files; rows of them lost in a broken file
  std::string refusal_;                       ///< the disk's error, while interrupted
  Clock::time_point refused_since_;
  std::vector<Sample> waiting_;  ///< rows of the interrupted block that wait for the disk
  std::vector<StoredEvent> waiting_events_;
  std::vector<ContactSample> waiting_contacts_;
  bool clocks_read_ = false;
  std::int64_t clocks_read_ns_ = 0;  ///< time of the last reading

  std::jthread thread_;  ///< last: it ends before the members that it uses
};

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
                   const RecorderOptions& options) {
  check(options);
  writer_ = std::make_unique<Writer>(file, header, columns, options);
}

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns)
    : Recorder(file, header, columns, RecorderOptions{}) {}

Recorder::~Recorder() {
  abandon();
}

void Recorder::start(std::int64_t monotonic_ns) noexcept {
  writer_->start(monotonic_ns);
}

void Recorder::push(const Sample& sample) noexcept {
  writer_->push(sample);
}

void Recorder::push(const Event& event) noexcept {
  writer_->push(event);
}

void Recorder::push_contact(const ContactSample& contact) noexcept {
  writer_->push_contact(contact);
}

void Recorder::between_ticks(bool may_wait) noexcept {
  if (may_wait) writer_->wait_for_room();
}

void Recorder::finish(const nlohmann::json& warnings) {
  writer_->finish(warnings);
}

void Recorder::abandon() noexcept {
  writer_->abandon();
}

RecorderStatus Recorder::status() const noexcept {
  return writer_->status();
}

std::vector<Warning> Recorder::take_warnings() {
  return writer_->take_warnings();
}

const std::string& Recorder::file() const noexcept {
  return writer_->file;
}

}  // namespace haptrace
