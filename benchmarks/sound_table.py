# SPDX-License-Identifier: Apache-2.0
"""What `eol bench sound` measured, for people."""


def lines(result: dict) -> list[str]:
    """Return the figures as lines; parts that were not measured are left out."""
    found = _engine(result)
    for name, ratio in result.get('ratios', {}).items():
        found.append(f'{name:60}{ratio:6.2f} x')
    if 'blocks_identical' in result:
        found.append(f'the same bits at any block size: {result["blocks_identical"]}')
    for part, tell in (('live', _live), ('rehearsal', _rehearsal), ('loss', _loss)):
        for row in result.get(part, ()):
            words, text = tell(row)
            found.append(f'{words}: {row["skipped"] if "skipped" in row else text()}')
    return found + _art(result.get('art'))


def _engine(result: dict) -> list[str]:
    rows = []
    for r in result.get('engine', ()):
        name = f'{"cubic" if r["cubic"] else "linear"}, speed {"0.5-2" if r["varied"] else "1"}'
        rows.append((f'mixer {name}', r, f'{r["error_db"]:10.1f}'))
    skipped = []
    for r in result.get('peers', ()):
        if 'skipped' in r:
            skipped.append(f'{r["name"]:28}{r["skipped"]}')
            continue
        name = f'{r["name"]}, {"0.5-2" if r["varied"] else "1"}'
        error = '   another' if r['error_db'] is None else f'{r["error_db"]:10.1f}'
        rows.append((name, r, error))
    if not rows:
        return skipped
    head = f'{"":28}{"grains":>8}{"block":>7}{"voices/core":>13}{"ns":>7}{"error dB":>10}'
    return [
        head,
        *(
            f'{name:28}{r["overlap"]:8}{r["block"]:7}{r["voices_per_core"]:13.0f}'
            f'{r["ns_per_voice_sample"]:7.2f}{error}'
            for name, r, error in rows
        ),
        *skipped,
    ]


def _live(r: dict):
    how = 'compiled' if r['compiled'] else 'python'
    words = f'real time, {how}, block {r["block"]}, {r["overlap"]} grains, busy {r["busy"]}'
    return (
        words,
        lambda: (
            f'{r["underruns"]} underruns in {r["seconds"]:.0f} s, '
            f'{r["unexplained_underruns"]} of them while the machine ran '
            f'(it stood still {r["machine_stalls"]} times, at most '
            f'{r["machine_stall_worst_ms"]:.1f} ms), {r["frames_per_second"]:.0f}/s, '
            f'load p99 {r["load_p99"]:.2f} worst {r["load_worst"]:.2f}, '
            f'stamp to sample sd {r["stamp_to_sample_sd"]:.2f} '
            f'worst {r["stamp_to_sample_worst"]:.1f} samples'
        ),
    )


def _rehearsal(r: dict):
    def text() -> str:
        ms, onset, trigger = r['latency_ms'], r['onset_to_stamp_ms'], r['stamp_to_trigger_ms']
        seen = r['seen_after_reckoning_ms']
        return (
            f'onset to first sample p50 {ms["p50"]:.1f}, p99 {ms["p99"]:.1f}, '
            f'most {ms["most"]:.1f} ms; {r["slips"]} slips, {100 * r["sounded"]:.1f} % sounded; '
            + ''.join(
                f'{sense} {one["count"]}: p50 {one["p50"]:.1f}, p99 {one["p99"]:.1f} ms; '
                for sense in ('felt', 'seen')
                if (one := r.get(f'{sense}_ms'))
            )
            + (
                f'{one["count"]} felt whose grains might sound: p99 {one["p99"]:.1f} ms; '
                if (one := r.get('felt_not_barred_ms'))
                else ''
            )
            + ''.join(
                f'knock to {topic} p50 {knock["p50"]:.1f}, p99 {knock["p99"]:.1f}, most '
                f'{knock["most"]:.1f} ms; '
                for topic, knock in r['knock_to_ms'].items()
            )
            + ', '.join(f'{r["motion"].get(k, 0)} {k}' for k in ('felt', 'confirmed', 'retracted'))
            + '; '
            f'onset to stamp p99 {onset["p99"]:.1f} ms, stamp to trigger p99 {trigger["p99"]:.1f} '
            f'ms, late {r["late"]} of {r["taken"]} ({r["late_before"]} of them while all was '
            f'starting), {r["underruns"]} underruns, card '
            f'{r["output_ms"]:.1f} ms more; the processors were {r["idle_percent"]:.0f} % idle, '
            f'{r["stolen_percent"]:.1f} % were withheld by the host'
            + (
                f'; {r["seen_alone"]} seen alone, off by {seen["least"]:.2f} to {seen["most"]:.2f} '
                'ms'
                if seen
                else ''
            )
            + ''.join(f'\n  {line}' for line in [*_hops(r['hops']), *r['restarts']])
        )

    return f'rehearsal, {r["device"]}', text


def _hops(hops: dict):
    for sense, found in hops.items():
        stood = found['late_while_it_stood']
        words = 'not watched for' if stood is None else f'{stood} of them in a standstill'
        yield (
            f'{sense}: {found["late"]} of {found["triggers"]} late, by {found["latest_ms"]:.1f} ms '
            f'at most ({words}); '
            + ', '.join(
                f'{hop} {one["p50"]:.2f} / {one["p99"]:.2f} / {one["most"]:.1f} ms'
                + (f' (made {one["made_late"]} late)' if one['made_late'] else '')
                for hop, one in found['hops'].items()
            )
        )


def _loss(r: dict):
    return (
        f'card away for {r["away_s"]:g} s',
        lambda: (
            f'noticed after {r["lost_s"]:.2f} s, sound on it {r["back_s"]:.2f} s after its return, '
            f'{r["restarts"]} restarts'
        ),
    )


def _art(r: dict | None) -> list[str]:
    if r is None:
        return []
    lines = [
        f'{r["grains_sounded"]} of {r["grains_reached"]} grains within reach sounded in '
        f'{r["seconds"]:.0f} s, and {r["creaks"]} creaks',
        f'{"areas":>16}{"cascades":>10}{"LUFS off":>10}{"on":>8}{"< 120 Hz off":>14}{"on":>8}'
        f'{"first 50 ms":>14}',
    ]
    for off, on in zip(r['off']['areas'], r['on']['areas'], strict=True):
        lines.append(
            f'{"{} to {}".format(*on["areas"]):>16}{on["cascades"]:10}{off["momentary_lufs"]:10.1f}'
            f'{on["momentary_lufs"]:8.1f}{off["below_120_hz"]:14.3f}{on["below_120_hz"]:8.3f}'
            f'{on["first_50_ms_db"]:11.1f} dB'
        )
    for name, unit in (
        ('single_to_rupture_lu', 'LU'), ('lra_lu', 'LU'), ('integrated_lufs', 'LUFS'),
        ('peak_dbfs', 'dBFS'), ('onset_frame', ''),
    ):  # fmt: skip
        lines.append(f'{name:24}{r["off"][name]:8.1f} off{r["on"][name]:8.1f} on  {unit}')
    worst = ', '.join(f'{hz} Hz {db:.0f}' for hz, db in r['filter_error_db'].items())
    lines.append(f'filter against SciPy, worst of all Q, dB: {worst}')
    for row in r['cost']:
        line = f'{row["part"]:24}{row["voices_per_core"]:10.0f} voices/core'
        if 'share' in row:
            line += f'{row["ns_per_voice_sample"]:8.2f} ns{100 * row["share"]:8.0f} %'
            if row['to_grain_buf']:
                line += f'{row["to_grain_buf"]:8.2f} x GrainBuf'
        lines.append(line)
    return lines
