#include "formats/recording_summary.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace haptrace {

void for_each_block(const RecordingReader& reader, const std::function<void(std::span<const Sample>)>& visit) {
  constexpr std::uint64_t kBlock = 8192;
  for (std::uint64_t first = 0; first < reader.rows(); first += kBlock) {
    const std::vector<Sample> block = reader.read(first, std::min(kBlock, reader.rows() - first));
    visit(block);
  }
}

RecordingSummary summarise(const RecordingReader& reader) {
  RecordingSummary summary;
  std::optional<Sample> before;
  double error2 = 0, peak2 = 0;
  std::int64_t first_ns = 0;
  for_each_block(reader, [&](std::span<const Sample> block) {
    for (const Sample& sample : block) {
      if (before) {
        const std::uint64_t step = sample.tick - before->tick;
        if (step > 1) {
          ++summary.gaps;
          summary.missed += step - 1;
        }
        summary.longest_interval =
            std::max(summary.longest_interval, 1e-9 * static_cast<double>(sample.time_ns - before->time_ns));
        summary.path_length += (sample.position - before->position).norm();
      } else {
        first_ns = sample.time_ns;
      }
      summary.bounds.include(sample.position);
      summary.max_force = std::max(summary.max_force, sample.force.norm());
      if (sample.phase == Phase::run && is_finite(sample.reference_position)) {
        const double e2 = (sample.position - sample.reference_position).squaredNorm();
        ++summary.tracked;
        error2 += e2;
        peak2 = std::max(peak2, e2);
      }
      before = sample;
    }
    summary.rows += block.size();
  });
  if (before) summary.duration = 1e-9 * static_cast<double>(before->time_ns - first_ns);
  if (summary.duration > 0) summary.mean_rate = static_cast<double>(summary.rows - 1) / summary.duration;
  if (summary.tracked > 0) {
    summary.rms_error = std::sqrt(error2 / static_cast<double>(summary.tracked));
    summary.peak_error = std::sqrt(peak2);
  }
  return summary;
}

}  // namespace haptrace
