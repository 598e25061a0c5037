#include "base/error.h"
#include "cli/live_page.h"
#include "cli/verb.h"
#include "formats/documents/session_log.h"
#include "view/recording_view.h"

#include <chrono>
#include <filesystem>
#include <fmt/format.h>
#include <thread>

namespace haptrace::cli {
namespace {

namespace fs = std::filesystem;

/// Returns the recordings of a session, in the order in which they were made.
std::vector<std::string> recordings_of(const std::string& where) {
  const SessionLog log = load_session_log(where);
  const fs::path folder = fs::is_directory(where) ? fs::path(where) : fs::path(where).parent_path();
  std::vector<std::string> files;
  for (const LoggedTrial& trial : log.trials)
    if (const fs::path file = folder / trial.file; fs::exists(file)) files.push_back(file.string());
  if (files.empty()) throw input_error(where + ": the session has no recordings yet");
  return files;
}

struct Arguments {
  std::string file;
  int port = 0;
  bool no_browser = false;
};

}  // namespace

Verb add_view(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("view", "look at a recording or a session in the browser");
  verb->footer(
      "Opens a page of this machine that shows the movement in space, the forces, and everything over time.\n"
      "To watch a session while it runs, give --view to record, play, guide or run.\n"
      "  haptrace view played.h5\n"
      "  haptrace view p07-monday --port 8123 --no-browser");
  verb->add_option("file", arguments->file, "recording (HDF5), or the folder of a session")->type_name("FILE");
  verb->add_option("--port", arguments->port, "port of the page on this machine (0: any free one)")
      ->capture_default_str();
  verb->add_flag("--no-browser", arguments->no_browser, "print the address only");

  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            require_page();
            check_range("--port", arguments->port, 0, 65535);
            const std::vector<std::string> files =
                is_session(arguments->file) ? recordings_of(arguments->file) : std::vector{arguments->file};
            const Signals signals;
            const RecordingView view(files, {.port = static_cast<std::uint16_t>(arguments->port)});
            const std::string address = view.address();
            if (output.json) output.tell({{"address", address}, {"files", files}}, "");
            output.remark(fmt::format("view: {} (Ctrl+C ends it)", address));
            if (!arguments->no_browser) (void)open_in_browser(address);
            while (signals.stop().count() == 0) std::this_thread::sleep_for(std::chrono::milliseconds(50));
            return kDone;
          }};
}

}  // namespace haptrace::cli
