// submapctl scip-decode: captured bytes of a scanner to events, one JSON line each.
#include <fmt/format.h>

#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "driver/scip/parser.hpp"
#include "tools/scip/scip_json.hpp"
#include "tools/submapctl/commands.hpp"

namespace submapd::tools {
namespace {

using driver::scip::Command;
using driver::scip::CommandKind;
using driver::scip::Parser;

// Hands the commands to the parser as fast as it has room for them: a capture may hold more than can be unanswered.
class Sent {
 public:
  Sent(std::vector<Command> commands, Parser& parser) : commands_(std::move(commands)), parser_(parser) {}

  void hand_on() {
    while (next_ < commands_.size() && parser_.expect(commands_[next_])) ++next_;
  }

 private:
  std::vector<Command> commands_;
  Parser& parser_;
  std::size_t next_ = 0;
};

int decode(const std::vector<std::string>& tx) {
  std::vector<Command> commands;
  for (const std::string& text : tx) {
    const std::optional<Command> command = Command::parse(text);
    if (!command) {
      fmt::print(stderr, "submapctl scip-decode: --tx \"{}\" is no SCIP command: 1 to {} printable characters\n", text,
                 Command::kCapacity);
      return 2;
    }
    const bool scan = command->kind() == CommandKind::kScanOnce || command->kind() == CommandKind::kScanStream;
    if (scan && command->request().beams() > Parser::kMaxBeams) {
      fmt::print(stderr, "submapctl scip-decode: --tx {} asks for {} beams, more than the {} of any known scanner\n",
                 text, command->request().beams(), Parser::kMaxBeams);
      return 2;
    }
    commands.push_back(*command);
  }
  const auto parser = std::make_unique<Parser>();
  Sent sent(std::move(commands), *parser);
  sent.hand_on();
  ScipJson lines([&sent](std::string_view line) {
    std::fwrite(line.data(), 1, line.size(), stdout);
    std::fputc('\n', stdout);
    sent.hand_on();
  });
  std::array<std::uint8_t, 65536> chunk;
  while (const std::size_t size = std::fread(chunk.data(), 1, chunk.size(), stdin)) {
    parser->feed(std::span(chunk).first(size), 0, lines);
  }
  parser->end(0, lines);
  if (std::ferror(stdin) != 0 || std::fflush(stdout) != 0) {
    fmt::print(stderr, "submapctl scip-decode: cannot read the standard input or write the standard output\n");
    return 1;
  }
  return 0;
}

}  // namespace

void register_scip_decode(CLI::App& app, CommandRun& run) {
  auto tx = std::make_shared<std::vector<std::string>>();
  CLI::App* command =
      app.add_subcommand("scip-decode", "Bytes of a scanner (standard input) to events, one JSON line each");
  command
      ->add_option("--tx", *tx,
                   "A command that was sent to the scanner, without its line feed; one option each, in order")
      ->expected(1)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->callback([tx, &run] { run = [tx] { return decode(*tx); }; });
}

}  // namespace submapd::tools
