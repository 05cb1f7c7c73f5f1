"""The work of `hab-eval serve`."""

from __future__ import annotations

from hab_eval.commands.options import ServeCommand
from hab_eval.integrations.server import PolicyServer, ServeOptions
from hab_eval.records.config import parse_options
from hab_eval.run.evaluate import check_device


def run(options: ServeCommand) -> int:
    """Serves an agent until the process is interrupted."""
    check_device(options.device)
    server = PolicyServer(
        ServeOptions(
            agent=options.agent,
            env=options.env,
            protocol=options.protocol,
            host=options.host,
            port=options.port,
            options=parse_options(options.option),
            seed=options.seed,
            device=options.device,
        )
    )
    print(f"serving {server.name} on {server.address} ({options.protocol})", flush=True)
    try:
        server.run()
    finally:
        server.close()
    return 0
