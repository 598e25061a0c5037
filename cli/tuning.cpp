#include "cli/tuning.h"

#include "control/error.h"

#include <fmt/format.h>

namespace haptrace::cli {

void TuningArguments::add_to(CLI::App& app) {
  app.add_option("--tune-port", port,
                 "take commands such as 'kp 2000' on this TCP port of this machine alone; 0: any free one, which is "
                 "told; see docs/tuning.md")
      ->type_name("PORT")
      ->group("Tuning");
  app.add_option("--tune-file", file, "obey the same commands in this file, a line each, whenever it changes")
      ->type_name("FILE")
      ->group("Tuning");
  app.add_flag("--expert", expert, "while tuning, trust the device with any gains")->group("Tuning");
}

TuningInputs::TuningInputs(const TuningArguments& arguments, LiveTuning& tuning) {
  // The file first: what it holds is in force before the session starts.
  if (!arguments.file.empty()) file_.emplace(tuning, arguments.file);
  if (arguments.port.empty()) return;
  try {
    server_.emplace(tuning, parse_tuning_port(arguments.port));
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("--tune-port: {}", error.what()));
  }
}

std::optional<std::uint16_t> TuningInputs::port() const noexcept {
  return server_ ? std::optional(server_->port()) : std::nullopt;
}

}  // namespace haptrace::cli
