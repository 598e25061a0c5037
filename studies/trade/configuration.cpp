#include "studies/trade/configuration.h"

#include <fmt/format.h>
#include <vector>

namespace haptrace {

std::string describe(const Compensations& with) {
  const std::vector<std::string> names = names_of(with);
  return names.empty() ? "PD alone" : fmt::format("{}", fmt::join(names, " + "));
}

std::string describe(const Configuration& configuration) {
  std::string text = fmt::format("{:g} Hz, {}, {}, {}", configuration.rate_hz, to_string(configuration.interpolation),
                                 configuration.velocity, describe(configuration.with));
  if (!configuration.law.empty()) text += fmt::format(", law {}", configuration.law);
  if (configuration.learn > 0) text += fmt::format(", {} repetitions learned", configuration.learn);
  if (configuration.thin > 1) text += fmt::format(", every {}th sample", configuration.thin);
  if (configuration.speed != 1) text += fmt::format(", {:g} times the speed", configuration.speed);
  return text;
}

bool is_lqg(const std::string& law) noexcept {
  return !law.empty() && law != to_string(TrackingLaw::observer);
}

PlayOptions play_options(const Configuration& configuration, const PlayOptions& base) {
  PlayOptions options = base;
  options.session.loop.rate_hz = configuration.rate_hz;
  options.session.velocity = configuration.velocity;
  options.interpolation = configuration.interpolation;
  options.compensations = configuration.with;
  options.compensations.learning = configuration.learn > 0;
  if (is_lqg(configuration.law)) {
    options.law = TrackingLaw::lqg;
    options.firmness = parse_firmness(configuration.law);
  } else if (!configuration.law.empty()) {
    options.law = parse_tracking_law(configuration.law);
    options.firmness.reset();
  }
  options.learn = configuration.learn;
  options.thin = configuration.thin;
  options.playback.speed = configuration.speed;
  options.playback.repetitions = std::max(1, configuration.learn);
  return options;
}

nlohmann::json config_file(const Configuration& configuration, const PlayOptions& base, const std::string& profile,
                           const Storage* storage) {
  const nlohmann::json loop{{"rate", configuration.rate_hz}, {"velocity", configuration.velocity}};
  nlohmann::json play = loop, guide = loop, record = loop;
  play["interpolation"] = to_string(configuration.interpolation);
  play["speed"] = configuration.speed;
  play["thin"] = configuration.thin;
  play["learn"] = configuration.learn;
  play["max-deviation"] = base.playback.max_deviation;
  for (nlohmann::json* verb : {&play, &guide}) {
    if (base.fit) (*verb)["fit"] = true;
    if (base.smoothing) (*verb)["smoothing"] = *base.smoothing;
  }
  if (profile.empty()) {
    play["no-profile"] = true;
  } else {
    play["profile"] = guide["profile"] = profile;
    Compensations with = configuration.with;
    with.learning = configuration.learn > 0;
    const std::vector<std::string> without = names_of(with, false);
    if (!without.empty()) play["without"] = without;
    if (!configuration.law.empty()) play[is_lqg(configuration.law) ? "firmness" : "law"] = configuration.law;
  }
  if (storage != nullptr) {
    for (nlohmann::json* verb : {&play, &guide, &record}) {
      (*verb)["compress"] = storage->deflate;
      (*verb)["precision"] = to_string(storage->precision);
    }
  }
  return {{"play", play}, {"guide", guide}, {"record", record}};
}

nlohmann::json to_json(const Configuration& configuration) {
  nlohmann::json with = nlohmann::json::array();
  for (const std::string& name : names_of(configuration.with)) with.push_back(name);
  return {{"rate_hz", configuration.rate_hz},   {"interpolation", to_string(configuration.interpolation)},
          {"velocity", configuration.velocity}, {"compensations", with},
          {"law", configuration.law},           {"learn", configuration.learn},
          {"thin", configuration.thin},         {"speed", configuration.speed}};
}

}  // namespace haptrace
