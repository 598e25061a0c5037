#include "recorder/capture.h"

#include "base/error.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <fmt/format.h>
#include <iterator>
#include <utility>

namespace haptrace {

void validate(const CaptureOptions& options) {
  if (options.pre && !(*options.pre >= 0 && *options.pre <= kLongestPre))
    throw input_error(fmt::format("the time to keep before the trigger is {} s; it must be from 0 to {} s",
                                  *options.pre, kLongestPre));
}

void Capture::feed(std::span<const Sample> samples, std::vector<TimedEvent> events,
                   std::span<const ContactSample> contacts) {
  contacts_.insert(contacts_.end(), contacts.begin(), contacts.end());
  const auto older = [](const TimedEvent& a, const TimedEvent& b) { return a.time_ns < b.time_ns; };
  waiting_.insert(waiting_.end(), std::make_move_iterator(events.begin()), std::make_move_iterator(events.end()));
  std::stable_sort(waiting_.begin(), waiting_.end(), older);
  auto event = waiting_.begin();
  for (; event != waiting_.end() && !samples.empty() && event->time_ns <= samples.back().time_ns; ++event) {
    const auto first_after =
        std::find_if(samples.begin(), samples.end(), [&](const Sample& s) { return s.time_ns >= event->time_ns; });
    const auto before = static_cast<std::size_t>(first_after - samples.begin());
    take(samples.first(before));
    samples = samples.subspan(before);
    take(*event);
  }
  waiting_.erase(waiting_.begin(), event);
  take(samples);
}

void Capture::finish() {
  for (const TimedEvent& event : waiting_) take(event);
  waiting_.clear();
}

void Capture::take(std::span<const Sample> samples) {
  if (!options_.mark_buttons) return keep(samples);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    std::uint32_t pressed = samples[i].buttons & ~std::exchange(buttons_, samples[i].buttons);
    if (pressed == 0) continue;
    // Write the mark before the sample in which the button went down.
    keep(samples.subspan(kept, i - kept));
    kept = i;
    for (; pressed != 0; pressed &= pressed - 1)
      write({samples[i].time_ns, EventCode::mark, fmt::format("button {}", std::countr_zero(pressed) + 1)});
  }
  keep(samples.subspan(kept));
}

void Capture::keep(std::span<const Sample> samples) {
  if (samples.empty()) return;
  if (paused_) return forget_contacts_before(samples.back().tick + 1);
  if (!armed()) return write(samples);
  before_.insert(before_.end(), samples.begin(), samples.end());
  const auto oldest = samples.back().time_ns - std::llround(1e9 * *options_.pre);
  while (before_.front().time_ns < oldest) before_.pop_front();
  forget_contacts_before(before_.front().tick);
}

void Capture::forget_contacts_before(std::uint64_t tick) {
  while (!contacts_.empty() && contacts_.front().tick < tick) contacts_.pop_front();
}

void Capture::take(const TimedEvent& event) {
  if (event.code == EventCode::paused) paused_ = true;
  if (event.code == EventCode::resumed) paused_ = false;
  if (event.code == EventCode::triggered && armed()) {
    triggered_ = true;
    const auto oldest = event.time_ns - std::llround(1e9 * *options_.pre);
    while (!before_.empty() && before_.front().time_ns < oldest) before_.pop_front();
    begin_ns_ = before_.empty() ? event.time_ns : before_.front().time_ns;
    const std::vector<Sample> kept(before_.begin(), before_.end());
    before_.clear();
    write(kept);
  }
  write(event);
}

void Capture::write(std::span<const Sample> samples) {
  if (samples.empty()) return;
  forget_contacts_before(samples.front().tick);
  scratch_contacts_.clear();
  for (; !contacts_.empty() && contacts_.front().tick <= samples.back().tick; contacts_.pop_front()) {
    scratch_contacts_.push_back(contacts_.front());
    scratch_contacts_.back().time_ns -= begin_ns_;
  }
  if (begin_ns_ == 0) return output_.append(samples, scratch_contacts_);
  scratch_.assign(samples.begin(), samples.end());
  for (Sample& sample : scratch_) sample.time_ns -= begin_ns_;
  output_.append(scratch_, scratch_contacts_);
}

void Capture::write(const TimedEvent& event) {
  // While armed, there is no recording yet that could keep the event.
  if (armed()) return;
  output_.append(StoredEvent{.time = 1e-9 * static_cast<double>(event.time_ns - begin_ns_),
                             .code = static_cast<std::int32_t>(event.code),
                             .text = event.text});
}

}  // namespace haptrace
