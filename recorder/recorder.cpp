#include "recorder/recorder.h"

#include "control/error.h"
#include "formats/disk_space.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <charconv>
#include <chrono>
#include <cmath>
#include <exception>
#include <fmt/format.h>
#include <mutex>
#include <thread>
#include <utility>

namespace haptrace {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kSmallestRing = 16384;  // rows: in virtual time the loop runs far ahead of the writer
constexpr double kChunkSpan = 2;  // of the session's time in a chunk at most: slow sessions make small files [s]
constexpr std::size_t kLargestChunk = 2048;  // rows
constexpr std::size_t kSmallestPacked = 32;  // rows of a chunk below which packing makes a file larger, not smaller
constexpr std::size_t kLargestBatch = 1024;  // rows
constexpr auto kPoll = std::chrono::milliseconds(5);
constexpr double kRestPerFlush = 4;
constexpr double kLookAround = 1;                        // between two looks at the file and its disk [s]
constexpr std::array<double, 2> kDiskWarnings{600, 60};  // told when the disk lasts no longer than that [s]
constexpr std::uint64_t kDiskFloor = 64U << 20U;         // free below which it is time to end [bytes]

std::size_t rows_in(double seconds, double rate_hz, std::size_t least) {
  return std::max(least, static_cast<std::size_t>(std::ceil(seconds * rate_hz)));
}

double seconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

std::string for_people(double seconds) {
  if (seconds >= 7200) return fmt::format("{:.0f} h", seconds / 3600);
  if (seconds >= 120) return fmt::format("{:.0f} min", seconds / 60);
  return fmt::format("{:.0f} s", seconds);
}

RecordingWriter::Options writer_options(const Recorder::Options& options, double rate_hz) {
  RecordingWriter::Options result{
      .overwrite = options.overwrite, .storage = options.storage, .in_parts = options.split.any()};
  // Packed chunks are written when they are full; others may be as large as they like.
  const std::size_t packed = rows_in(options.flush_period, rate_hz, 1);
  if (options.storage.filtered() && packed < kSmallestPacked)
    throw input_error(fmt::format(
        "at {:g} Hz a recording cannot be packed while it grows: a packed piece of {} samples would be larger than the "
        "samples. Record it as it is and use haptrace convert --compress afterwards",
        rate_hz, packed));
  result.storage.rows_per_chunk =
      options.storage.filtered() ? packed : std::min(rows_in(kChunkSpan, rate_hz, 64), kLargestChunk);
  return result;
}

void check(const Recorder::Options& options) {
  validate(options.storage);
  validate(options.capture);
  if (!(options.sync_period >= 0 && options.sync_period <= 3600))
    throw input_error(
        fmt::format("the period of --sync is {} s; it must be from 0 (never) to 3600 s", options.sync_period));
}

}  // namespace

Split parse_split(std::string_view text) {
  struct Unit {
    std::string_view name;
    double factor;
    bool time;
  };
  static constexpr std::array<Unit, 9> kUnits{{{"s", 1, true},
                                               {"min", 60, true},
                                               {"h", 3600, true},
                                               {"MB", 1e6, false},
                                               {"GB", 1e9, false},
                                               {"TB", 1e12, false},
                                               {"MiB", 0x1p20, false},
                                               {"GiB", 0x1p30, false},
                                               {"TiB", 0x1p40, false}}};
  double number = 0;
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, number);
  const std::string_view suffix(rest, static_cast<std::size_t>(end - rest));
  for (const Unit& unit : kUnits) {
    if (error != std::errc{} || suffix != unit.name) continue;
    const double value = number * unit.factor;
    if (unit.time && value >= 1 && value <= 1e7) return {.seconds = value};
    if (!unit.time && value >= 1e6 && value <= 0x1p50) return {.bytes = static_cast<std::uint64_t>(value)};
  }
  throw input_error(
      fmt::format("split '{}' is neither a time from 1 s (s, min, h) nor a size from 1 MB (MB, GB, TB, MiB, GiB, TiB); "
                  "write, for example, 30min or 1GiB",
                  text));
}

/// The writer thread and what it shares with the others.
class Recorder::Writer final : private Capture::Output {
 public:
  Writer(const std::string& name, const RecordingHeader& header, const RecordingColumns& columns,
         const Options& options)
      : file(name),
        samples(rows_in(options.ring_seconds, header.rate_hz, kSmallestRing)),
        events(rows_in(options.ring_seconds, header.rate_hz, kSmallestRing)),
        options_(options),
        bytes_per_second_(static_cast<double>(row_bytes(columns)) * header.rate_hz),
        loop_waits_(header.clock == "virtual"),
        output_(name, header, columns, writer_options(options, header.rate_hz)),
        capture_(options.capture, *this) {
    look_at_disk();
    if (const double seconds = disk_seconds_.load(); options.tell_room && seconds > 0 && warnings_told_ == 0)
      warn(Warning::Severity::note, "disk_space",
           fmt::format("{}: the disk has room for {}", output_.part(), for_people(seconds)));
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

  void push(const Sample& sample) noexcept {
    if (options_.annotations) options_.annotations->tick(sample.time_ns);
    if (!samples.push(sample)) lose();
  }

  void push(const Event& event) noexcept {
    if (!events.push(event)) lose();
  }

  /// After a failure nothing is kept any more: that is told as such, and not counted.
  void lose() noexcept {
    if (!failed_.load(std::memory_order_relaxed)) lost_.fetch_add(1, std::memory_order_relaxed);
  }

  void wait_for_room() noexcept {
    while (samples.write_available() == 0 && !failed_.load(std::memory_order_acquire))
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
      std::rethrow_exception(std::exchange(error_, nullptr));
    }
    output_.warn(warnings);
    output_.finish();
  }

  void abandon() noexcept {
    stop();
    output_.abandon();
  }

  [[nodiscard]] Status status() const noexcept {
    Status status{.written = written_.load(std::memory_order_relaxed),
                  .lost = lost_.load(std::memory_order_relaxed),
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

 private:
  /// Until asked to stop, and then until the rings are empty.
  void run(const std::stop_token& stop) noexcept {
    try {
      auto flushed = Clock::now(), synced = flushed, looked = flushed;
      double cost = 0;  // of the last flush [s]
      for (bool last = false; !last;) {
        const bool stopping = stop.stop_requested();
        const bool wrote = drain();
        last = stopping && !wrote;
        const auto now = Clock::now();
        alive_.store(now.time_since_epoch().count(), std::memory_order_relaxed);
        const double rest = rest_after(cost);
        const bool sync =
            options_.sync_period > 0 && seconds_between(synced, now) >= std::max(options_.sync_period, rest);
        if (sync || seconds_between(flushed, now) >= std::max(options_.flush_period, rest)) {
          if (sync)
            output_.sync();
          else
            output_.flush();
          flushed = Clock::now();
          if (sync) synced = flushed;
          cost = seconds_between(now, flushed);
          split_by_size();
          look_at_disk();
        }
        if (seconds_between(looked, now) >= kLookAround) {
          look_at_file();
          looked = now;
        }
        if (!wrote && !last) std::this_thread::sleep_for(kPoll);
      }
      capture_.finish();
      if (capture_.armed())
        warn(Warning::Severity::warning, "no_trigger", file + ": the trigger did not fire; nothing was recorded");
    } catch (const std::exception& error) {
      warn(Warning::Severity::error, "recording_failed",
           std::string(error.what()) + "; the session goes on without it");
      error_ = std::current_exception();
      failed_.store(true, std::memory_order_release);
    }
  }

  /// How long to leave the file alone after a flush of this cost. On a disk so slow that samples wait meanwhile, to
  /// catch up comes before making the file whole [s].
  [[nodiscard]] double rest_after(double cost) const {
    return !loop_waits_ && samples.read_available() >= kLargestBatch ? kRestPerFlush * cost : 0;
  }

  /// True when there was anything.
  bool drain() {
    // Samples first: an event is pushed before the sample of its tick, so that all events of these samples are there.
    while (batch_.size() < kLargestBatch &&
           samples.consume_one([&](const Sample& sample) { batch_.push_back(sample); })) {
    }
    std::vector<TimedEvent> happened;
    events.consume_all([&](const Event& event) { happened.push_back({event.time_ns, event.code, describe(event)}); });
    if (options_.annotations) {
      std::vector<TimedEvent> said = options_.annotations->take();
      happened.insert(happened.end(), std::make_move_iterator(said.begin()), std::make_move_iterator(said.end()));
    }
    if (!batch_.empty()) last_time_ns_ = batch_.back().time_ns;
    tell_losses(happened);
    if (batch_.empty() && happened.empty()) return false;
    capture_.feed(batch_, std::move(happened));
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

  void append(std::span<const Sample> kept) override {
    const auto span_ns = std::llround(1e9 * options_.split.seconds);
    while (!kept.empty()) {
      std::size_t count = kept.size();
      if (span_ns > 0) {
        const auto next = std::find_if(kept.begin(), kept.end(),
                                       [&](const Sample& s) { return s.time_ns - part_begin_ns_ >= span_ns; });
        count = static_cast<std::size_t>(next - kept.begin());
      }
      output_.append(kept.first(count));
      written_.fetch_add(count, std::memory_order_relaxed);
      kept = kept.subspan(count);
      if (kept.empty()) break;
      start_part(kept.front().time_ns);
    }
  }

  void append(const StoredEvent& event) override { output_.append(event); }

  void split_by_size() {
    if (options_.split.bytes > 0 && output_.part_bytes() >= options_.split.bytes) start_part(last_time_ns_);
  }

  void start_part(std::int64_t begin_ns) {
    output_.start_part();
    part_begin_ns_ = begin_ns;
    parts_.fetch_add(1, std::memory_order_relaxed);
  }

  void look_at_file() {
    const std::string misplaced = output_.misplaced();
    if (!misplaced.empty() && misplaced != misplaced_told_) warn(Warning::Severity::warning, "file_moved", misplaced);
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
      warn(Warning::Severity::warning, "disk_space",
           fmt::format("{}: the disk has room for {} more", output_.part(), for_people(seconds)));
    if (disk_low_.load(std::memory_order_relaxed) || space.free > std::min(kDiskFloor, space.total / 100)) return;
    warn(Warning::Severity::warning, "disk_space",
         fmt::format("{}: the disk is almost full, {:.1f} MB are left; end the session or make room", output_.part(),
                     1e-6 * static_cast<double>(space.free)));
    disk_low_.store(true, std::memory_order_relaxed);
  }

  void warn(Warning::Severity severity, const char* code, std::string text) noexcept {
    const std::lock_guard lock(warnings_mutex_);
    warnings_.push_back({severity, code, kNaN, std::move(text)});
  }

  const Options options_;
  const double bytes_per_second_;  ///< of the session's time
  const bool loop_waits_;          ///< in virtual time it can wait for the disk, see between_ticks
  std::atomic<std::uint64_t> written_{0}, lost_{0};
  std::atomic<std::uint32_t> parts_{1};
  std::atomic<bool> failed_{false}, armed_{false}, paused_{false}, disk_low_{false};
  std::atomic<double> disk_seconds_{0};
  std::atomic<Clock::rep> alive_{Clock::now().time_since_epoch().count()};
  std::mutex warnings_mutex_;
  std::vector<Warning> warnings_;

  // The writer thread's own.
  RecordingWriter output_;
  Capture capture_;
  std::vector<Sample> batch_;
  std::uint64_t lost_told_ = 0;
  std::int64_t last_time_ns_ = 0, part_begin_ns_ = 0;
  std::string misplaced_told_;
  std::size_t warnings_told_ = 0;
  std::exception_ptr error_;  ///< read after join

  std::jthread thread_;  ///< last: it ends before what it uses
};

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns,
                   const Options& options) {
  check(options);
  writer_ = std::make_unique<Writer>(file, header, columns, options);
}

Recorder::Recorder(const std::string& file, const RecordingHeader& header, const RecordingColumns& columns)
    : Recorder(file, header, columns, Options{}) {}

Recorder::~Recorder() {
  abandon();
}

void Recorder::push(const Sample& sample) noexcept {
  writer_->push(sample);
}

void Recorder::push(const Event& event) noexcept {
  writer_->push(event);
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

Recorder::Status Recorder::status() const noexcept {
  return writer_->status();
}

std::vector<Warning> Recorder::take_warnings() {
  return writer_->take_warnings();
}

const std::string& Recorder::file() const noexcept {
  return writer_->file;
}

}  // namespace haptrace
