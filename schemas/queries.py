"""Every question that a service answers, once: key template, what is asked, what is answered."""

from __future__ import annotations

from schemas import bridge, retention
from schemas.message import Message
from schemas.topic import Query

INGEST = Query(
    "{kind}/{place}/ingest/{shard}",
    bridge.BridgeBatch,
    bridge.BridgeAcknowledgement,
    "records of a bridge, answered once they are durable",
)
STORE = Query("cloud/{cloud}/store/{shard}", bridge.StoreQuestion, bridge.StoreAnswer, "rows of a cloud's history")
HISTORY_TASK = Query(
    "cloud/{cloud}/history_task/{shard}",
    bridge.HistoryTask,
    bridge.HistoryTaskDone,
    "to learn the radio from a cloud's history, or to analyse it anew; answered once it is done",
)
RETAINED = Query(
    "{kind}/{place}/retained/{service}",
    retention.RetainedQuestion,
    retention.RetainedAnswer,
    "what a service still keeps of its KEPT publications; the runtime answers for it",
)
QUERIES: tuple[Query[Message, Message], ...] = (INGEST, STORE, HISTORY_TASK, RETAINED)
