#include "formats/resample.h"

#include "control/error.h"
#include "formats/recording_formats.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr std::size_t kContext = 64, kCore = 2048;  // samples

template <class Value>
Value lerp(const Value& a, const Value& b, double u) {
  return u == 0 ? a : Value(a + u * (b - a));
}

Quat slerp(const Quat& a, const Quat& b, double u) {
  if (u == 0) return a;
  return a.coeffs().allFinite() && b.coeffs().allFinite() ? Quat(a.slerp(u, b)) : nan_quat();
}

/// What lies between two samples, the position excepted.
Sample between(const Sample& a, const Sample& b, double u) {
  Sample sample = a;
  sample.velocity = lerp(a.velocity, b.velocity, u);
  sample.force = lerp(a.force, b.force, u);
  sample.torque = lerp(a.torque, b.torque, u);
  sample.force_measured = lerp(a.force_measured, b.force_measured, u);
  sample.reference_position = lerp(a.reference_position, b.reference_position, u);
  sample.reference_velocity = lerp(a.reference_velocity, b.reference_velocity, u);
  sample.reference_force = lerp(a.reference_force, b.reference_force, u);
  sample.progress = lerp(a.progress, b.progress, u);
  sample.tunnel_radius = lerp(a.tunnel_radius, b.tunnel_radius, u);
  sample.orientation = slerp(a.orientation, b.orientation, u);
  sample.reference_orientation = slerp(a.reference_orientation, b.reference_orientation, u);
  return sample;
}

class Resampled final : public ResampledSource {
 public:
  Resampled(std::unique_ptr<RecordingSource> source, const ResampleOptions& options)
      : source_(std::move(source)), options_(options), header_(source_->header()) {
    header_.uuid = new_uuid();
    header_.rate_hz = options.rate_hz;
    input_ = source_->next();
    if (!input_.empty()) start_ns_ = input_.front().time_ns;
    report_.max_gap = options.max_gap > 0 ? options.max_gap : 20 * median_step(input_);
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return source_->events(); }
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
      if (number > 0) notes.push_back(fmt::format("{} rows left out: {}", number, what));
    };
    count(report_.duplicates, "their stamp equals that of the row before");
    count(report_.backward, "their stamp lies before that of an earlier row");
    count(report_.without_position, "they have no position");
    if (report_.gaps > 0)
      notes.push_back(fmt::format("{} gaps longer than {:.4g} s stay gaps, the longest of {:.4g} s", report_.gaps,
                                  report_.max_gap, report_.longest_gap));
    return notes;
  }

 private:
  static double median_step(std::span<const Sample> samples) {
    std::vector<std::int64_t> steps;
    for (std::size_t i = 1; i < samples.size(); ++i)
      if (samples[i].time_ns > samples[i - 1].time_ns) steps.push_back(samples[i].time_ns - samples[i - 1].time_ns);
    if (steps.empty()) return 0;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return 1e-9 * static_cast<double>(*middle);
  }

  [[nodiscard]] std::int64_t grid_ns(std::uint64_t k) const {
    return start_ns_ + std::llround(static_cast<double>(k) * (1e9 / options_.rate_hz));
  }

  /// The next sample that counts, or null at the end.
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

  /// Fills the window with samples of one segment. False when there is none left.
  bool fill() {
    if (ended_) {  // and evaluated
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

  /// The positions of the window, with the reflections that make it start and end without acceleration.
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

  /// Answers the grid's instants up to the last sample whose surroundings are known, and forgets what is behind it.
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
    // The originals behind the last row cannot be compared yet: they stay, with their surroundings.
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

  /// How far the curve through the last two rows is from the samples between them.
  void compare(const Sample& sample, const Vec3& velocity) {
    const bool follows = last_out_ && last_out_->tick + 1 == sample.tick;
    for (; next_original_ < window_.size() && window_[next_original_].time_ns <= sample.time_ns; ++next_original_) {
      const Sample& original = window_[next_original_];
      if (!follows || original.time_ns < last_out_->time_ns) continue;
      const double difference = (curve(sample, velocity, original.time_ns) - original.position).norm();
      ++report_.compared;
      squares_ += difference * difference;
      report_.max_difference = std::max(report_.max_difference, difference);
      report_.rms_difference = std::sqrt(squares_ / static_cast<double>(report_.compared));
    }
    last_out_ = sample;
    last_velocity_ = velocity;
  }

  /// Between the last row and `b`, with the velocities of the curve there: as the method would run.
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
  ResampleReport report_;
  std::int64_t start_ns_ = 0;

  std::span<const Sample> input_;  ///< the source's present block
  std::size_t taken_ = 0;          ///< of it
  std::optional<std::int64_t> last_ns_;

  std::vector<Sample> window_;          ///< consecutive samples of one segment
  bool begins_ = true, ended_ = false;  ///< the window has the segment's first and last sample
  std::optional<Sample> following_;     ///< the first sample of the next segment
  std::size_t core_ = 0;                ///< of the window: answered up to this one's stamp
  std::uint64_t next_k_ = 0;            ///< the next instant of the grid

  std::vector<Sample> output_;
  std::size_t next_original_ = 0;  ///< of the window: not compared yet
  std::optional<Sample> last_out_;
  Vec3 last_velocity_ = Vec3::Zero();
  double squares_ = 0;  // [m^2]
};

}  // namespace

std::unique_ptr<ResampledSource> resample(std::unique_ptr<RecordingSource> source, const ResampleOptions& options) {
  constexpr double kSlowest = 1, kFastest = 1e6;  // [Hz]
  if (!(options.rate_hz >= kSlowest && options.rate_hz <= kFastest))
    throw input_error(
        fmt::format("--resample: {} is not a rate from {} to {} Hz", options.rate_hz, kSlowest, kFastest));
  if (!(options.max_gap >= 0)) throw input_error(fmt::format("--max-gap: {} is not a duration in s", options.max_gap));
  return std::make_unique<Resampled>(std::move(source), options);
}

}  // namespace haptrace
