const found = document.createElement("div"), look = "position:absolute;z-index:10;padding:2px 6px;";
found.id = "name";
found.style = look + "font:bold 16px sans-serif;background:white;pointer-events:none";
document.body.append(found);
addEventListener("pointermove", (event) => {
  found.textContent = "";
  found.style.left = event.clientX + 14 + "px";
  found.style.top = event.clientY + 14 + "px";
}, true);
K3DInstance.on(K3DInstance.events.OBJECT_HOVERED, (hit) => {
  found.textContent = K3DInstance.getWorld().ObjectsListJson[hit.K3DIdentifier].name;
});
