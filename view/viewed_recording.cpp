#include "view/viewed_recording.h"

#include "base/error.h"
#include "base/json_reader.h"
#include "formats/recording/recording_stream.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unordered_map>
#include <utility>

namespace haptrace {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kChunk = 8192;             // rows read at once
constexpr std::uint64_t kMostOfBlock = 4'000'000;  // rows of a block whose times are far denser than its rate
constexpr std::uint64_t kMostOfPath = 120'000;     // rows of a run that are searched for its path
constexpr std::size_t kMostEvents = 4000;          // that a page gets
constexpr std::int64_t kMostBlocks = 20'000;       // of a recording; a longer one has a longer row period
constexpr double kFull = 0.9;                      // share of the memory for cells beyond which nothing is built ahead

/// The strongest contact of each tick of some samples.
class StrongestContacts {
 public:
  StrongestContacts(const RecordingReader& reader, std::span<const Sample> samples) {
    if (!reader.columns().contacts) return;
    constexpr std::uint64_t kBlock = 8192;
    for (std::uint64_t first = reader.contact_at(samples.front().time_ns);; first += kBlock) {
      const std::vector<ContactSample> block = reader.contacts(first, kBlock);
      for (const ContactSample& contact : block) {
        if (contact.tick > samples.back().tick) return;
        const auto [found, added] = contacts_.try_emplace(contact.tick, contact);
        if (!added && contact.force.squaredNorm() > found->second.force.squaredNorm()) found->second = contact;
      }
      if (block.size() < kBlock) return;
    }
  }

  /// Returns null if nothing was touched.
  [[nodiscard]] const ContactSample* of(std::uint64_t tick) const {
    const auto found = contacts_.find(tick);
    return found == contacts_.end() ? nullptr : &found->second;
  }

 private:
  std::unordered_map<std::uint64_t, ContactSample> contacts_;
};

/// Ends the reading of an overview that the file does not have.
struct NoOverview : std::exception {};

void put_limit(nlohmann::json& limits, const char* name, const nlohmann::json& config, const char* key) {
  if (!config.is_object()) return;
  const auto found = config.find(key);
  if (found != config.end() && found->is_number() && found->get<double>() > 0) limits[name] = *found;
}

}  // namespace

ViewedRecording::ViewedRecording(const std::string& file, std::chrono::milliseconds patience) : patience_(patience) {
  if (!is_hdf5(file)) {
    open_stream(file);
    return;
  }
  reader_.emplace(file, RecordingReader::Parts::present);
  reader_->on_damage([this](const RecordingReader::Damage& damage) {
    if (damage_.empty()) damage_ = damage.file + ": " + damage.path + ": " + damage.what;
  });
  header_ = reader_->header();
  unfinished_ = !header_.complete;
  columns_ = reader_->columns();
  channels_ = ViewChannels(columns_);
  rows_ = reader_->rows();
  events_ = reader_->events();
  if (rows_ > 0) {
    constexpr std::array<std::string_view, 1> kTime{"time"};
    first_ns_ = reader_->read(0, 1, kTime).front().time_ns;
    last_ns_ = std::max(first_ns_, reader_->read(rows_ - 1, 1, kTime).front().time_ns);
  }
  read_overview();
  // The period follows the rows if these are denser than the rate in the header.
  const double mean =
      last_ns_ > first_ns_ ? 1e9 * static_cast<double>(rows_ - 1) / static_cast<double>(last_ns_ - first_ns_) : 1000;
  const double rate = std::isfinite(header_.rate_hz) && header_.rate_hz >= mean / 2 ? header_.rate_hz : mean;
  const std::int64_t shortest = (last_ns_ - first_ns_) / (kMostBlocks * PyramidBlock::kRows);
  history_.emplace(channels_.size(), std::max<std::int64_t>(std::llround(1e9 / std::clamp(rate, 1e-3, 1e9)), shortest));
  focus_ = history_->block_of(first_ns_);
}

ViewedRecording::~ViewedRecording() = default;

/// Reads a recording or a path in a text format, or XDF, into memory. The bounds of the history apply.
void ViewedRecording::open_stream(const std::string& file) {
  const auto source = open_source(file);
  header_ = source->header();
  columns_ = source->columns();
  channels_ = ViewChannels(columns_);
  events_ = source->events();
  const double rate = header_.rate_hz > 0 && std::isfinite(header_.rate_hz) ? header_.rate_hz : 1000;
  history_.emplace(channels_.size(), std::llround(1e9 / std::clamp(rate, 1e-3, 1e9)));
  std::vector<float> values(channels_.size());
  for (std::span<const Sample> block = source->next(); !block.empty(); block = source->next())
    for (const Sample& sample : block) {
      channels_.fill(sample, values);
      if (rows_++ == 0) first_ns_ = sample.time_ns;
      last_ns_ = std::max(last_ns_, sample.time_ns);
      history_->append(sample.time_ns, values);
    }
}

void ViewedRecording::read_overview() {
  try {
    // Rows are read only if the file has no overview; then nothing is known ahead.
    overview_ = reader_->overview([rows = rows_](std::uint64_t) {
      if (rows > 100 * kChunk) throw NoOverview();
    });
  } catch (const NoOverview&) {
    overview_.clear();
  } catch (const Error& error) {
    damage_ = error.what();
    overview_.clear();
  }
}

/// Returns the first row at or after a time.
std::uint64_t ViewedRecording::row_from(std::int64_t time_ns) const {
  if (time_ns <= first_ns_) return 0;
  if (time_ns > last_ns_) return rows_;
  return reader_->row_at(time_ns - 1) + 1;
}

/// Reads a block.
void ViewedRecording::build(std::int64_t block) {
  ViewRows rows(channels_.size());
  try {
    std::uint64_t row = row_from(history_->block_begin(block));
    const std::uint64_t past = std::min(row_from(history_->block_begin(block + 1)), row + kMostOfBlock);
    std::vector<float> values(channels_.size());
    while (row < past) {
      const std::vector<Sample> samples = reader_->read(row, std::min(kChunk, past - row));
      if (samples.empty()) break;
      const StrongestContacts contacts(*reader_, samples);
      for (const Sample& sample : samples) {
        if (history_->block_of(sample.time_ns) != block) continue;
        if (rows.size() > 0 && sample.time_ns <= rows.time_ns.back()) continue;
        channels_.fill(sample, values, contacts.of(sample.tick));
        rows.add(sample.time_ns, values);
      }
      row += samples.size();
    }
  } catch (const Error& error) {
    if (damage_.empty()) damage_ = error.what();
  }
  history_->put(block, std::move(rows));
}

std::int64_t ViewedRecording::width_of(const ViewRequest& request) const {
  const std::int64_t from = std::clamp(nanoseconds(request.t0), first_ns_, last_ns_);
  return history_->bin_width(from, std::clamp(nanoseconds(request.t1), from, last_ns_), request.pixels);
}

/// Returns a block that an exact answer needs and that is not there.
std::optional<std::int64_t> ViewedRecording::missing_block(const ViewRequest& request) const {
  if (!reader_ || rows_ == 0) return std::nullopt;
  const bool bins = request.kind == ViewRequest::Kind::bins;
  const std::int64_t width = bins ? width_of(request) : 0;
  const std::int64_t from = std::clamp(nanoseconds(request.t0), first_ns_, last_ns_);
  const std::int64_t to = std::clamp(nanoseconds(request.t1), from, last_ns_);
  const std::int64_t span = history_->period() * std::max<std::int64_t>(width, 1);
  const std::int64_t last = history_->block_of(bins ? std::min(to + span, last_ns_) : to);
  for (std::int64_t block = history_->block_of(bins ? std::max(from - span, first_ns_) : from); block <= last; ++block)
    if (bins && width >= PyramidBlock::kBase ? !history_->has_cells(block, width) : !history_->has_rows(block))
      return block;
  return std::nullopt;
}

void ViewedRecording::ask(const ViewRequest& request, const Reply& reply) {
  const auto began = Clock::now();
  const bool rows = request.kind == ViewRequest::Kind::rows;
  ViewRequest bounded = request;
  // An answer of rows never needs more than these.
  if (rows) {
    bounded.t0 = std::max(request.t0, seconds(first_ns_));
    bounded.t1 = std::min(request.t1, bounded.t0 + 4 * static_cast<double>(kMostRows) * seconds(history_->period()));
  }
  const double middle = request.t0 / 2 + request.t1 / 2;
  focus_ = history_->block_of(std::clamp(nanoseconds(middle), first_ns_, last_ns_));
  std::optional<std::int64_t> missing = missing_block(bounded);
  while (missing && (rows || Clock::now() - began < patience_)) {
    build(*missing);
    missing = missing_block(bounded);
  }
  if (!missing) {
    Frame frame = answer_from(*history_, bounded, first_ns_, last_ns_);
    if (rows && bounded.t1 < std::min(request.t1, seconds(last_ns_))) frame.flags |= FrameFlags::kCut;
    return reply(std::move(frame));
  }
  wanted_.push_front(request);
  if (wanted_.size() > kMostWanted) wanted_.pop_back();
  reply(coarse(request));
}

/// Returns bins from the blocks that are there, and from the overview elsewhere.
Frame ViewedRecording::coarse(const ViewRequest& request) {
  const std::int64_t from = std::clamp(nanoseconds(request.t0), first_ns_, last_ns_);
  const std::int64_t to = std::clamp(nanoseconds(request.t1), from, last_ns_);
  const std::int64_t width = width_of(request);
  ViewBins bins = history_->bins(from, to, width, request.channels);
  for (const RecordingSummary& part : overview_) {
    if (part.last_ns < bins.first_ns || part.rows == 0) continue;
    const std::int64_t first = std::max<std::int64_t>((part.first_ns - bins.first_ns) / bins.width_ns, 0);
    const std::int64_t last =
        std::min((part.last_ns - bins.first_ns) / bins.width_ns, static_cast<std::int64_t>(bins.count) - 1);
    for (std::int64_t k = first; k <= last; ++k) {
      const std::int64_t begin = bins.first_ns + k * bins.width_ns;
      if (history_->has_cells(history_->block_of(std::max(begin, part.first_ns)), width)) continue;
      for (std::size_t i = 0; i < request.channels.size(); ++i) {
        const std::string_view name = channels_[request.channels[i]].name;
        PyramidBin& bin = bins.channels[i][static_cast<std::size_t>(k)];
        const int axis = name == "x" ? 0 : name == "y" ? 1 : name == "z" ? 2 : -1;
        if (axis >= 0 && part.bounds.min[axis] <= part.bounds.max[axis]) {
          bin.add(static_cast<float>(part.bounds.min[axis]));
          bin.add(static_cast<float>(part.bounds.max[axis]));
        } else if (name == "force") {
          bin.add(0);
          bin.add(static_cast<float>(part.max_force));
        } else if (name == "deviation" && part.tracked > 0) {
          bin.add(0);
          bin.add(static_cast<float>(std::sqrt(part.error2_peak)));
        }
      }
    }
  }
  Frame frame = frame_of(bins);
  frame.request = request.id;
  frame.flags |= FrameFlags::kCoarse;
  return frame;
}

/// Returns the nearest block to what was asked for last that is not built.
std::optional<std::int64_t> ViewedRecording::next_block() const {
  if (!reader_ || rows_ == 0) return std::nullopt;
  if (static_cast<double>(history_->cell_memory()) > kFull * static_cast<double>(History::Bounds().cells))
    return std::nullopt;
  const std::int64_t first = history_->block_of(first_ns_), last = history_->block_of(last_ns_);
  for (std::int64_t away = 0; focus_ + away <= last || focus_ - away >= first; ++away)
    for (const std::int64_t block : {focus_ + away, focus_ - away})
      if (block >= first && block <= last && !history_->has_cells(block, PyramidBlock::kBase)) return block;
  return std::nullopt;
}

bool ViewedRecording::work() {
  std::erase_if(wanted_, [this](const ViewRequest& request) { return !missing_block(request); });
  // A short stretch is soon ready.
  const auto shortest =
      std::min_element(wanted_.begin(), wanted_.end(),
                       [](const ViewRequest& a, const ViewRequest& b) { return a.t1 - a.t0 < b.t1 - b.t0; });
  const std::optional<std::int64_t> block = shortest != wanted_.end() ? missing_block(*shortest) : next_block();
  if (!block) return false;
  build(*block);
  return true;
}

nlohmann::json ViewedRecording::recording(std::size_t index, const std::string& name) const {
  const nlohmann::json& config = header_.config;
  nlohmann::json limits = nlohmann::json::object();
  if (header_.max_force_n > 0) limits["max_force"] = header_.max_force_n;
  put_limit(limits, "max_force", config, "max-force");
  put_limit(limits, "max_deviation", config, "max-deviation");
  put_limit(limits, "max_speed", config, "max-velocity");
  std::string input = text_in(config, "input");
  if (const auto said = header_.meta.find("input"); said != header_.meta.end()) input = said->second;
  nlohmann::json message{{"type", "recording"},
                         {"index", index},
                         {"name", name},
                         {"title", header_.title},
                         {"subject", header_.subject},
                         {"session", header_.uuid},
                         {"verb", text_in(config, "verb")},
                         {"mode", text_in(config, "mode")},
                         {"rate_hz", json_of_number(header_.rate_hz)},
                         {"start", seconds(first_ns_)},
                         {"end", seconds(last_ns_)},
                         {"device",
                          {{"name", header_.device_name},
                           {"model", header_.device_model},
                           {"max_force", json_of_number(header_.max_force_n)},
                           {"position_resolution", json_of_number(header_.position_resolution_m)}}},
                         {"columns", json_of(channels_)},
                         {"limits", limits},
                         {"input", input},
                         {"virtual_time", header_.clock == "virtual"}};
  RecordingSummary all;
  for (const RecordingSummary& part : overview_) all.join(part);
  if (all.rows > 0 && is_finite(all.bounds.min) && is_finite(all.bounds.max))
    message["bounds"] = {{"min", haptrace::json_of(all.bounds.min)}, {"max", haptrace::json_of(all.bounds.max)}};
  return message;
}

nlohmann::json ViewedRecording::events() const {
  nlohmann::json list = nlohmann::json::array();
  for (const StoredEvent& event : std::span(events_).first(std::min(events_.size(), kMostEvents)))
    list.push_back(event_json(event));
  if (events_.size() > kMostEvents)
    list.push_back(event_json(events_[kMostEvents].time, static_cast<std::int32_t>(EventCode::mark),
                              fmt::format("{} further events are not shown", events_.size() - kMostEvents)));
  return events_message(std::move(list), true);
}

bool ViewedRecording::scan_phases(std::chrono::milliseconds patience) {
  const auto began = Clock::now();
  while (!phases_known_) {
    try {
      scan_some_phases();
    } catch (const Error& error) {
      if (damage_.empty()) damage_ = error.what();
      scanned_ = rows_;  // the stretches up to the damage are known
    }
    if (scanned_ >= rows_) {
      phases_.finish();
      phases_known_ = true;
    } else if (Clock::now() - began >= patience) {
      break;
    }
  }
  return phases_known_;
}

/// Looks at the next rows, or at a block of the overview that holds nothing but a run.
void ViewedRecording::scan_some_phases() {
  if (!reader_) {
    const auto phase = channels_.find("phase");
    bool cut = false;
    const ViewRows rows = history_->rows(first_ns_, last_ns_, static_cast<std::size_t>(-1), cut);
    for (std::size_t row = 0; row < rows.size(); ++row)
      phases_.add(rows.time_ns[row], static_cast<Phase>(std::lround(rows.planes[*phase][row])));
    scanned_ = rows_;
    return;
  }
  if (scanned_ >= scan_end_) {
    scan_end_ = rows_;
    if (scanned_parts_ < overview_.size()) {
      const RecordingSummary& part = overview_[scanned_parts_++];
      scan_end_ = std::min(rows_, scanned_ + part.rows);
      if (part.run_rows == part.rows && part.runs == 1) {
        phases_.add(part.first_ns, Phase::run);
        phases_.add(part.last_ns, Phase::run);
        scanned_ = scan_end_;
        return;
      }
    }
  }
  constexpr std::array<std::string_view, 2> kNames{"time", "phase"};
  const std::vector<Sample> samples = reader_->read(scanned_, std::min(kChunk, scan_end_ - scanned_), kNames);
  for (const Sample& sample : samples) phases_.add(sample.time_ns, sample.phase);
  scanned_ = samples.empty() && scan_end_ > scanned_ ? rows_ : scanned_ + samples.size();
}

/// Returns the rows of the first run.
std::vector<Sample> ViewedRecording::read_run() const {
  std::vector<Sample> run;
  std::uint64_t row = 0;
  for (const RecordingSummary& part : overview_) {
    if (part.run_rows > 0) break;
    row += part.rows;
  }
  constexpr std::array<std::string_view, 5> kNames{"time", "phase", "reference_position", "progress", "tunnel_radius"};
  for (std::uint64_t end = row + kMostOfPath; row < std::min(rows_, end);) {
    const std::vector<Sample> samples = reader_->read(row, kChunk, kNames);
    if (samples.empty()) break;
    row += samples.size();
    for (const Sample& sample : samples) {
      if (sample.phase == Phase::run)
        run.push_back(sample);
      else if (!run.empty())
        return run;
    }
  }
  return run;
}

Frame ViewedRecording::path() const {
  FollowedPath path;
  if (!columns_.reference || !reader_) return frame_of(path);
  try {
    std::vector<Sample> run = read_run();
    // The point on the path of a guided hand goes back and forth with the hand.
    if (columns_.guidance &&
        std::any_of(run.begin(), run.end(), [](const Sample& s) { return std::isfinite(s.progress); })) {
      std::erase_if(run, [](const Sample& s) { return !std::isfinite(s.progress); });
      std::stable_sort(run.begin(), run.end(),
                       [](const Sample& a, const Sample& b) { return a.progress < b.progress; });
    }
    for (const Sample& sample : run) {
      path.time.push_back(seconds(sample.time_ns));
      path.position.push_back(sample.reference_position);
      if (columns_.tunnel) path.radius.push_back(sample.tunnel_radius);
    }
  } catch (const Error&) {
    path = {};
  }
  return frame_of(path);
}

}  // namespace haptrace
