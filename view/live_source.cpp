#include "view/live_source.h"

#include <algorithm>
#include <cmath>

namespace haptrace {
namespace {

constexpr std::int64_t kRateWindow = 1'000'000'000;  // [ns]

std::int64_t period_of(double rate_hz) {
  return rate_hz > 0 ? std::llround(1e9 / rate_hz) : 1'000'000;
}

}  // namespace

LiveSource::LiveSource(const ViewedSession& session)
    : channels_(session.columns),
      history_(channels_.size(), period_of(session.rate_hz)),
      fresh_(channels_.size()),
      values_(channels_.size()) {}

void LiveSource::ask(const ViewRequest& request, const Reply& reply) {
  reply(answer_from(history_, request, 0, std::max<std::int64_t>(history_.last_time(), 0)));
}

void LiveSource::add(const Sample& sample, const ContactSample* contact) {
  channels_.fill(sample, values_, contact);
  history_.append(sample.time_ns, values_);
  fresh_.add(sample.time_ns, values_);
  phases.add(sample.time_ns, sample.phase);
  newest_ = sample;
  ++rows_;
  ++window_rows_;
  if (sample.time_ns - window_ns_ < kRateWindow) return;
  window_length_ns_ = sample.time_ns - window_ns_;
  window_ns_ = sample.time_ns;
  last_window_rows_ = window_rows_;
  window_rows_ = 0;
}

ViewRows LiveSource::take() {
  ViewRows taken = std::move(fresh_);
  fresh_ = ViewRows(channels_.size());
  return taken;
}

ViewRows LiveSource::rows_after(double time, double most) const {
  const std::int64_t last = history_.last_time();
  const std::int64_t from = std::max(nanoseconds(time) + 1, last - nanoseconds(most));
  bool cut = false;
  return history_.rows(from, last, static_cast<std::size_t>(-1), cut);
}

double LiveSource::time() const noexcept {
  return newest_ ? seconds(newest_->time_ns) : 0;
}

double LiveSource::rate() const noexcept {
  const std::int64_t length = window_length_ns_ > 0 || !newest_ ? window_length_ns_ : newest_->time_ns;
  const std::uint64_t rows = window_length_ns_ > 0 ? last_window_rows_ : rows_;
  return length > 0 ? 1e9 * static_cast<double>(rows) / static_cast<double>(length) : 0;
}

}  // namespace haptrace
