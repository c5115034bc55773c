# SPDX-License-Identifier: Apache-2.0
"""What bringup tells the processes that it starts: names of variables of their environment."""

HEALTH_FD = 'EOL_HEALTH_FD'
"""The descriptor of the pipe for heartbeats, and for the progress of the compiler."""
KEPT = 'EOL_KEPT'
"""JSON by node: what each kept in the process that bringup saw end."""
AGAIN = 'EOL_AGAIN'
"""Set where the others run already: they are met soon, or not at all."""
