#include "formats/convert/resample.h"

#include "base/error.h"
#include "base/statistics.h"
#include "formats/convert/low_pass.h"
#include "formats/recording/recording_formats.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::size_t kContext = 64, kCore = 2048;  // samples
constexpr double kLower = 0.95;                     // new rate / old rate below which a low-pass filter is needed
constexpr double kBelowNewRate = 2.4;  // new rate / cut-off: the filter passes nothing above half the new rate

template <class Value>
Value lerp(const Value& a, const Value& b, double u) {
  return u == 0 ? a : Value(a + u * (b - a));
}

Quat slerp(const Quat& a, const Quat& b, double u) {
  if (u == 0) return a;
  return a.coeffs().allFinite() && b.coeffs().allFinite() ? Quat(a.slerp(u, b)) : nan_quat();
}

/// Interpolates between two samples all values but the position.
Sample between(const Sample& a, const Sample& b, double u) {
  Sample sample = a;
  sample.velocity = lerp(a.velocity, b.velocity, u);
  sample.force = lerp(a.force, b.force, u);
  sample.torque = lerp(a.torque, b.torque, u);
  sample.force_measured = lerp(a.force_measured, b.force_measured, u);
  sample.support = lerp(a.support, b.support, u);
  sample.reference_position = lerp(a.reference_position, b.reference_position, u);
  sample.reference_velocity = lerp(a.reference_velocity, b.reference_velocity, u);
  sample.reference_force = lerp(a.reference_force, b.reference_force, u);
  sample.progress = lerp(a.progress, b.progress, u);
  sample.tunnel_radius = lerp(a.tunnel_radius, b.tunnel_radius, u);
  sample.kp = lerp(a.kp, b.kp, u);
  sample.kd = lerp(a.kd, b.kd, u);
  sample.orientation = slerp(a.orientation, b.orientation, u);
  sample.reference_orientation = slerp(a.reference_orientation, b.reference_orientation, u);
  return sample;
}

/// Accumulates distances between positions.
class Differences {
 public:
  void add(double difference) {
    ++compared_;
    squares_ += difference * difference;
    max_ = std::max(max_, difference);
  }
  void put_into(ResampleReport& report) const {
    report.compared = compared_;
    report.max_difference = max_;
    report.rms_difference = compared_ > 0 ? std::sqrt(squares_ / static_cast<double>(compared_)) : 0;
  }

 private:
  std::uint64_t compared_ = 0;
  double squares_ = 0, max_ = 0;  // [m^2], [m]
};

class Resampled final : public ResampledSource {
 public:
  Resampled(std::unique_ptr<RecordingSource> source, const ResampleOptions& options)
      : source_(std::move(source)), options_(options), header_(source_->header()) {
    header_.uuid = new_uuid();
    header_.rate_hz = options.rate_hz;
    columns_ = source_->columns();
    columns_.contacts = false;
    input_ = source_->next();
    if (!input_.empty()) start_ns_ = input_.front().time_ns;
    const double step = median_step(input_);
    report_.max_gap = options.max_gap > 0 ? options.max_gap : 20 * step;
    const bool lower = step > 0 && options.rate_hz * step < kLower;
    report_.low_pass_hz = options.low_pass_hz.value_or(lower ? options.rate_hz / kBelowNewRate : 0);
    if (report_.low_pass_hz > 0 && !(2 * report_.low_pass_hz < options.rate_hz))
      throw input_error(
          fmt::format("--low-pass: {:g} Hz is not below half of {:g} Hz", report_.low_pass_hz, options.rate_hz));
    // The filter needs a grid as fine as the source to see what it removes.
    if (report_.low_pass_hz > 0 && step > 0)
      finer_ = static_cast<std::uint64_t>(std::max(1.0, std::ceil(1 / (options.rate_hz * step))));
    options_.rate_hz *= static_cast<double>(finer_);
  }

  /// Return the rate of the grid [Hz], and its multiple of the requested rate, which exceeds 1 only for a low-pass
  /// filter.
  [[nodiscard]] double grid_hz() const { return options_.rate_hz; }
  [[nodiscard]] std::uint64_t finer() const { return finer_; }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return columns_; }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return source_->events(); }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return source_->clocks(); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }
  [[nodiscard]] const ResampleReport& report() const override { return report_; }

  std::span<const Sample> next() override {
    output_.clear();
    while (output_.empty() && (fill() || !window_.empty())) evaluate();
    report_.rows_out += output_.size();
    return output_;
  }

  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = source_->notes();
    const auto count = [&](std::uint64_t number, const char* what) {
      if (number > 0) notes.push_back(fmt::format("{} samples left out: {}", number, what));
    };
    count(report_.duplicates, "their time stamp equals that of the previous sample");
    count(report_.backward, "their time stamp is before that of an earlier sample");
    count(report_.without_position, "they have no position");
    if (source_->columns().contacts)
      notes.emplace_back("the contacts with the scene were left out: they belong to the ticks of the session");
    if (report_.gaps > 0)
      notes.push_back(fmt::format("{} gaps longer than {:.4g} s were not filled; the longest lasts {:.4g} s",
                                  report_.gaps, report_.max_gap, report_.longest_gap));
    return notes;
  }

 private:
  static double median_step(std::span<const Sample> samples) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < samples.size(); ++i)
      if (samples[i].time_ns > samples[i - 1].time_ns)
        steps.push_back(1e-9 * static_cast<double>(samples[i].time_ns - samples[i - 1].time_ns));
    return steps.empty() ? 0 : median(std::move(steps));
  }

  [[nodiscard]] std::int64_t grid_ns(std::uint64_t k) const {
    return start_ns_ + std::llround(static_cast<double>(k) * (1e9 / options_.rate_hz));
  }

  /// Returns the next sample that is not dropped, or null at the end.
  const Sample* pull() {
    for (;;) {
      if (taken_ == input_.size()) {
        input_ = input_.empty() ? input_ : source_->next();
        taken_ = 0;
        if (input_.empty()) return nullptr;
      }
      const Sample& sample = input_[taken_++];
      ++report_.rows_in;
      if (last_ns_ && sample.time_ns <= *last_ns_) {
        ++(sample.time_ns == *last_ns_ ? report_.duplicates : report_.backward);
      } else if (!is_finite(sample.position)) {
        ++report_.without_position;
      } else {
        last_ns_ = sample.time_ns;
        return &sample;
      }
    }
  }

  /// Fills the window with samples of one segment. Returns false if none is left.
  bool fill() {
    if (ended_) {  // all samples of the segment have been evaluated
      window_.clear();
      if (!following_) return false;
      window_.push_back(*following_);
      following_.reset();
      ended_ = false;
      begins_ = true;
      core_ = 0;
      next_original_ = 0;
      last_out_.reset();
    }
    while (!ended_ && window_.size() < core_ + kCore + kContext) {
      const Sample* sample = pull();
      if (sample == nullptr) {
        ended_ = true;
      } else if (!window_.empty() && gap_to(*sample) > report_.max_gap) {
        ended_ = true;
        following_ = *sample;
        ++report_.gaps;
        report_.longest_gap = std::max(report_.longest_gap, gap_to(*sample));
      } else {
        if (window_.empty()) begins_ = true;
        window_.push_back(*sample);
      }
    }
    return !window_.empty();
  }

  [[nodiscard]] double gap_to(const Sample& sample) const {
    return 1e-9 * static_cast<double>(sample.time_ns - window_.back().time_ns);
  }

  [[nodiscard]] double seconds(std::int64_t time_ns) const {
    return 1e-9 * static_cast<double>(time_ns - window_.front().time_ns);
  }

  /// Returns the positions of the window, with the reflections that make it start and end without acceleration.
  [[nodiscard]] Path path(double& start) const {
    Path path;
    path.name = "resample";
    const auto add = [&](double t, const Vec3& p) {
      path.time.push_back(t);
      path.position.push_back(p);
    };
    const std::size_t size = window_.size(), mirrored = std::min(kContext, size - 1);
    const Sample &first = window_.front(), &last = window_.back();
    if (begins_)
      for (std::size_t i = mirrored; i >= 1; --i)
        add(-seconds(window_[i].time_ns), 2 * first.position - window_[i].position);
    for (const Sample& sample : window_) add(seconds(sample.time_ns), sample.position);
    if (ended_)
      for (std::size_t i = 1; i <= mirrored; ++i) {
        const Sample& sample = window_[size - 1 - i];
        add(2 * seconds(last.time_ns) - seconds(sample.time_ns), 2 * last.position - sample.position);
      }
    start = path.time.front();
    return path;
  }

  /// Evaluates the grid up to the last sample with known surroundings, and discards samples that are no longer needed.
  void evaluate() {
    const std::size_t last = ended_ ? window_.size() - 1 : window_.size() - 1 - kContext;
    const std::int64_t limit_ns = window_[last].time_ns;
    double start = 0;
    const Trajectory trajectory(path(start), options_.method);
    Trajectory::Cursor cursor;
    std::size_t i = 0;
    const auto first_k = static_cast<double>(window_[core_].time_ns - start_ns_) * 1e-9 * options_.rate_hz;
    next_k_ = std::max(next_k_, static_cast<std::uint64_t>(std::max(0.0, std::floor(first_k))));
    for (; grid_ns(next_k_) <= limit_ns; ++next_k_) {
      const std::int64_t now = grid_ns(next_k_);
      if (now < window_[core_].time_ns) continue;
      while (i + 1 < window_.size() && window_[i + 1].time_ns <= now) ++i;
      emit(trajectory.sample(seconds(now) - start, cursor), i, now);
    }
    // Originals after the last new sample cannot be compared yet: they stay, with their surroundings.
    core_ = last;
    const std::size_t forget = std::min({last - std::min(last, kContext), next_original_, last});
    if (ended_ || forget == 0) return;
    begins_ = false;
    window_.erase(window_.begin(), window_.begin() + static_cast<std::ptrdiff_t>(forget));
    core_ -= forget;
    next_original_ -= forget;
  }

  void emit(const Reference& reference, std::size_t i, std::int64_t now) {
    const Sample& a = window_[i];
    const bool exact = a.time_ns == now || i + 1 == window_.size();
    const bool hold = exact || options_.method == Interpolation::hold;
    Sample sample = a;
    if (!hold) {
      const Sample& b = window_[i + 1];
      sample = between(a, b, static_cast<double>(now - a.time_ns) / static_cast<double>(b.time_ns - a.time_ns));
      sample.position = reference.position;
    }
    if (!is_finite(a.velocity)) sample.velocity = reference.velocity;
    sample.tick = next_k_;
    sample.time_ns = now;
    output_.push_back(sample);
    compare(sample, reference.velocity);
  }

  /// Compares the curve through the last two new samples with the originals between them.
  void compare(const Sample& sample, const Vec3& velocity) {
    const bool follows = last_out_ && last_out_->tick + 1 == sample.tick;
    for (; next_original_ < window_.size() && window_[next_original_].time_ns <= sample.time_ns; ++next_original_) {
      const Sample& original = window_[next_original_];
      if (!follows || original.time_ns < last_out_->time_ns) continue;
      differences_.add((curve(sample, velocity, original.time_ns) - original.position).norm());
    }
    differences_.put_into(report_);
    last_out_ = sample;
    last_velocity_ = velocity;
  }

  /// Returns the curve between the last new sample and `b`, with its velocities there, as `method` interpolates.
  [[nodiscard]] Vec3 curve(const Sample& b, const Vec3& velocity, std::int64_t time_ns) const {
    const Sample& a = *last_out_;
    const double h = 1e-9 * static_cast<double>(b.time_ns - a.time_ns);
    const double u = 1e-9 * static_cast<double>(time_ns - a.time_ns) / h, w = 1 - u;
    const Vec3 d = b.position - a.position;
    switch (options_.method) {
      case Interpolation::hold:
        return time_ns == b.time_ns ? b.position : a.position;
      case Interpolation::linear:
        return a.position + u * d;
      default:  // cubic Hermite
        return a.position + u * u * (3 - 2 * u) * d + u * w * w * h * last_velocity_ - u * u * w * h * velocity;
    }
  }

  std::unique_ptr<RecordingSource> source_;
  ResampleOptions options_;
  RecordingHeader header_;
  RecordingColumns columns_;
  ResampleReport report_;
  std::int64_t start_ns_ = 0;
  std::uint64_t finer_ = 1;

  std::span<const Sample> input_;  ///< present block of the source
  std::size_t taken_ = 0;          ///< samples of the block that were used
  std::optional<std::int64_t> last_ns_;

  std::vector<Sample> window_;          ///< consecutive samples of one segment
  bool begins_ = true, ended_ = false;  ///< the window contains the segment's first and last sample
  std::optional<Sample> following_;     ///< the first sample of the next segment
  std::size_t core_ = 0;                ///< index in the window; evaluated up to its stamp
  std::uint64_t next_k_ = 0;            ///< next index of the grid

  std::vector<Sample> output_;
  std::size_t next_original_ = 0;  ///< index in the window; not compared yet
  std::optional<Sample> last_out_;
  Vec3 last_velocity_ = Vec3::Zero();
  Differences differences_;  ///< between the curve and the samples
};

/// Low-pass filters the samples and keeps every n-th one.
class Thinned final : public ResampledSource {
 public:
  explicit Thinned(std::unique_ptr<Resampled> source)
      : source_(std::move(source)), low_pass_(source_->report().low_pass_hz, source_->grid_hz()) {}

  [[nodiscard]] const RecordingHeader& header() const override { return source_->header(); }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return source_->events(); }
  [[nodiscard]] std::vector<ClockReading> clocks() const override { return source_->clocks(); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }
  [[nodiscard]] const ResampleReport& report() const override { return report_; }

  std::span<const Sample> next() override {
    output_.clear();
    while (output_.empty() && fill()) {
      const std::size_t known = ended_ ? stretch_.size() : stretch_.size() - low_pass_.reach();
      for (; at_ < known; ++at_)
        if (stretch_[at_].tick % source_->finer() == 0) keep(low_pass_.at(stretch_, at_));
      const std::size_t forget = at_ - std::min(at_, low_pass_.reach());
      stretch_.erase(stretch_.begin(), stretch_.begin() + static_cast<std::ptrdiff_t>(forget));
      at_ -= forget;
    }
    const std::uint64_t rows_out = report_.rows_out + output_.size();
    report_ = source_->report();
    report_.rows_out = rows_out;
    differences_.put_into(report_);
    return output_;
  }

  [[nodiscard]] std::vector<std::string> notes() const override {
    std::vector<std::string> notes = source_->notes();
    notes.push_back(
        fmt::format("low-pass filter at {:.4g} Hz: it removed {:.3g} mm rms from the position; --low-pass 0 "
                    "switches it off",
                    report_.low_pass_hz, 1e3 * report_.rms_difference));
    return notes;
  }

 private:
  /// Adds samples to the stretch, which has no gaps, or begins the next one after its end. Returns false if none is
  /// left.
  bool fill() {
    if (ended_) {
      stretch_.assign(input_.begin() + static_cast<std::ptrdiff_t>(taken_),
                      input_.begin() + static_cast<std::ptrdiff_t>(std::min(taken_ + 1, input_.size())));
      taken_ += stretch_.size();
      at_ = 0;
      ended_ = false;
      if (stretch_.empty() && finished_) return false;
    }
    while (!ended_ && stretch_.size() < at_ + low_pass_.reach() + kCore) {
      if (taken_ == input_.size()) {
        input_ = source_->next();
        taken_ = 0;
        finished_ = input_.empty();
      }
      ended_ = finished_ || (!stretch_.empty() && input_[taken_].tick != stretch_.back().tick + 1);
      if (!ended_) stretch_.push_back(input_[taken_++]);
    }
    return !stretch_.empty();
  }

  void keep(Sample sample) {
    differences_.add((sample.position - stretch_[at_].position).norm());
    sample.tick /= source_->finer();
    output_.push_back(sample);
  }

  std::unique_ptr<Resampled> source_;
  LowPass low_pass_;
  ResampleReport report_;
  std::span<const Sample> input_;  ///< present block of the source
  std::size_t taken_ = 0;          ///< samples of the block that were used
  std::vector<Sample> stretch_;    ///< samples without a gap
  std::size_t at_ = 0;             ///< index in the stretch of the next sample to filter
  bool ended_ = false;             ///< the stretch contains its last sample
  bool finished_ = false;          ///< the source has no more samples
  std::vector<Sample> output_;
  Differences differences_;  ///< between filtered and unfiltered samples
};

}  // namespace

std::unique_ptr<ResampledSource> resample(std::unique_ptr<RecordingSource> source, const ResampleOptions& options) {
  constexpr double kSlowest = 1, kFastest = 1e6;  // [Hz]
  if (!(options.rate_hz >= kSlowest && options.rate_hz <= kFastest))
    throw input_error(
        fmt::format("--resample: {} is not a rate from {} to {} Hz", options.rate_hz, kSlowest, kFastest));
  if (!(options.max_gap >= 0)) throw input_error(fmt::format("--max-gap: {} is not a duration in s", options.max_gap));
  if (!(options.low_pass_hz.value_or(0) >= 0))
    throw input_error(fmt::format("--low-pass: {} is not a frequency in Hz", *options.low_pass_hz));
  auto resampled = std::make_unique<Resampled>(std::move(source), options);
  if (resampled->report().low_pass_hz == 0) return resampled;
  return std::make_unique<Thinned>(std::move(resampled));
}

}  // namespace haptrace
